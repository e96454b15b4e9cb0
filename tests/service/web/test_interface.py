"""What all routes of the interface have in common: HEAD, refused query parameters, and a document for programs."""

from __future__ import annotations

import re
from typing import Any

import pytest
from openapi_spec_validator import validate

from tests.service.harness import Harness, assert_problem

# Verbs that a generated client shows; a new one is added here on purpose.
VERBS = "accept acquire cancel change close compare create delete dismiss download end explain forget get import"
VERBS += " invite join"
VERBS += (
    " leave list move pause postpone redeem register release remove renew rescore reset resume revoke sign start step"
)
VERBS += " stream update upload verify"


@pytest.fixture
def document(service: Harness) -> dict[str, Any]:
    found: dict[str, Any] = service.client.get("/openapi.json").json()
    return found


def operations(document: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {
        f"{method.upper()} {path}": operation
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    }


def test_every_get_answers_head_alike_and_without_a_body(service: Harness) -> None:
    team = service.caller("team")
    team.agent("a")
    evaluation = team.evaluation("a")
    paths = ["/", "/health/live", "/health/ready", "/openapi.json", "/v1/agents", "/v1/agents/a", "/v1/me", "/nowhere"]
    paths += [f"/v1/evaluations/{evaluation}", "/v1/evaluations/none", "/static/none.js", "/v1/benchmarks?limit=0"]
    for path in paths:
        got, head = (service.client.request(method, path, headers=team.headers) for method in ("GET", "HEAD"))
        assert (head.status_code, head.content) == (got.status_code, b""), path
        different = {"x-request-id", "date"}
        assert {key: value for key, value in head.headers.items() if key not in different} == {
            key: value for key, value in got.headers.items() if key not in different
        }, path
    assert service.client.head("/v1/rescore").status_code == 405


def test_head_of_a_stream_ends(service: Harness) -> None:
    team = service.caller("team")
    team.agent("a")
    answer = service.client.head(f"/v1/evaluations/{team.evaluation('a')}/progress", headers=team.headers)
    assert answer.headers["content-type"].startswith("text/event-stream")


def test_unknown_query_parameters_are_refused_with_their_place(service: Harness) -> None:
    team = service.caller("team")
    refused = team.get("/v1/agents?limit=5&owner=me")
    assert_problem(refused, 422, "query.owner", "expected limit, after")
    assert refused.json()["errors"] == [
        {"where": "query.owner", "expected": "unknown parameter; expected limit, after"}
    ]
    assert_problem(team.get("/v1/me?x="), 422, "expected none here")
    assert_problem(team.post("/v1/agents?dry_run=true", {"name": "a"}), 422, "query.dry_run")
    assert team.get("/v1/agents").json()["items"] == []


def test_every_operation_with_parameters_still_takes_them(service: Harness, document: dict[str, Any]) -> None:
    for name, operation in operations(document).items():
        method, path = name.split(" ", 1)
        given = [one["name"] for one in operation.get("parameters", ()) if one["in"] == "query"]
        if method == "GET" and given:
            answer = service.caller("team").get(re.sub(r"\{\w+\}", "none", path), params=dict.fromkeys(given, "1"))
            assert "unknown parameter" not in answer.text, name


def test_the_document_is_valid_openapi(document: dict[str, Any]) -> None:
    validate(document)
    assert document["servers"]
    assert len(document["info"]["description"]) > 200
    names = [tag["name"] for tag in document["tags"]]
    assert len(names) == len(set(names))
    used = {tag for operation in operations(document).values() for tag in operation["tags"]}
    assert used == set(names)


def test_operations_are_named_as_a_person_would(document: dict[str, Any]) -> None:
    names = [operation["operationId"] for operation in operations(document).values()]
    assert len(names) == len(set(names))
    pattern = re.compile(rf"({'|'.join(VERBS.split())})(_[a-z]+)+")
    assert [name for name in names if not pattern.fullmatch(name)] == []
    assert all(operation.get("description") for operation in operations(document).values())


def undescribed(document: dict[str, Any]) -> list[str]:
    """Properties of schemas, and parameters, that have no description."""
    found = [
        f"{schema}.{name}"
        for schema, body in document["components"]["schemas"].items()
        for name, one in body.get("properties", {}).items()
        if "description" not in one and "$ref" not in one
    ]
    return found + [
        f"{name} {one['name']}"
        for name, operation in operations(document).items()
        for one in operation.get("parameters", ())
        if "description" not in one
    ]


def test_every_property_is_described(document: dict[str, Any]) -> None:
    assert undescribed(document) == []
