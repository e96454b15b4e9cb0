"""Every operation of the published interface, under requests that are made up: no 5xx, and nothing undocumented."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.service.harness import Harness

EXAMPLES = 7


@pytest.mark.slow
def test_no_request_of_any_role_finds_an_undocumented_answer(tmp_path: Path) -> None:
    """A cheap share of `python -m tests.performance.fuzz`."""
    from tests.service.web.fuzzing import CALLERS, find_faults, listening  # three seconds, for one test

    with listening(tmp_path / "data") as (url, service):
        assert find_faults(url, service, list(CALLERS), EXAMPLES, each=False) == []


def test_every_operation_is_described(service: Harness) -> None:
    document = service.client.get("/openapi.json").json()
    tags = {tag["name"] for tag in document["tags"]}
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            where = f"{method.upper()} {path}"
            assert operation.get("description"), where
            assert set(operation["tags"]) <= tags, where
            assert {"401", "422", "429", "503"} <= set(operation["responses"]), where
            for status, response in operation["responses"].items():
                if status >= "400" and status != "416":
                    assert list(response["content"]) == ["application/problem+json"], (where, status)


def test_bodies_have_examples_that_are_taken_for_what_they_are(service: Harness) -> None:
    document = service.client.get("/openapi.json").json()
    for name in ("TokenOrder", "AgentOrder", "BuiltinOrder", "RemoteOrder", "EvaluationOrder", "WebhookOrder"):
        assert document["components"]["schemas"][name]["examples"], name
