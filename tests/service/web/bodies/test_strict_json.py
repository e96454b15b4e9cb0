"""Hostile documents to every route that takes one: refused with the place, and no list is poisoned afterwards."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest
from fastapi.routing import APIRoute

from dohyo.service.accounts.model import Role
from dohyo.service.app import ROUTERS
from dohyo.service.web.bodies.strict_json import DEEPEST, MOST_KEYS, MOST_VALUES, JsonError, parse_json, readable
from dohyo.service.web.bodies.strict_route import ANONYMOUS_BYTES, StrictRoute
from dohyo.service.wire.messages import Format
from tests.service.harness import Caller, assert_problem, running

HOSTILE = {
    "half a surrogate pair": r'"\ud800"',
    "a NUL": r'"a\u0000b"',
    "an escape character": r'"\u001b[2J"',
    "an integer beyond 64 bits": "9223372036854775808",
    "an integer of a million digits": "9" * 100_000,
    "NaN": "NaN",
    "infinity": "1e999",
    "minus infinity": "-Infinity",
    "a key twice": '{"a": 1, "a": 2}',
    "a key with half a surrogate pair": r'{"\udfff": 1}',
    "a key without end": '{"' + "k" * 10_000 + '": 1}',
    "deep lists": "[" * 5_000 + "]" * 5_000,
    "deep objects": '{"a":' * 500 + "1" + "}" * 500,
    "thousands of keys": "{" + ",".join(f'"k{number}": 0' for number in range(2_000)) + "}",
    "thousands of values": "[" + ",".join("0" * 1 for _ in range(30_000)) + "]",
}
ORDERS: dict[str, dict[str, Any]] = {
    "/v1/tokens": {"owner": "blue", "role": "reader", "expires_in_days": 3},
    "/v1/agents": {"name": "other", "description": "Of another owner."},
    "/v1/agents/{name}/submissions": {
        "kind": "remote", "name": "x", "track": "map", "sensors": ["speedometer"], "control": "target_speed_steering",
        "entry": "a:B", "source_sha256": "", "settings": {"x": 1},
    },
    "/v1/evaluations": {"agent": "mine", "version": 1, "benchmark": "quickstart", "seeds": [1], "name": "mine"},
    "/v1/rescore": {"evaluation": "ev-0000000000000000", "rules": "2.0"},
    "/v1/challenges": {"name": "cup", "title": "A cup", "rules": "Be fair."},
    "/v1/webhooks": {"url": "https://example.org/hook", "secret": "0123456789abcdef"},
}  # fmt: skip
LISTS = (
    *("/v1/tokens", "/v1/agents", "/v1/agents/mine", "/v1/agents/mine/submissions", "/v1/evaluations"),
    *("/v1/webhooks", "/v1/challenges", "/v1/leaderboard?benchmark=quickstart", "/v1/networks", "/v1/benchmarks"),
)


@pytest.fixture(scope="module")
def team(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Caller]:
    with running(tmp_path_factory.mktemp("service")) as service:
        caller = service.caller("team", Role.ADMIN)
        caller.agent("mine")
        yield caller


def routes_with_a_document() -> list[APIRoute]:
    routes = [route for router in ROUTERS for route in router.routes if isinstance(route, APIRoute)]
    return [route for route in routes if route.body_field is not None]


def documents(order: dict[str, Any], hostile: str) -> Iterator[tuple[str, str]]:
    """An order with a hostile value in each of its fields, in a field of no name, and inside of its settings."""
    mark = "HOSTILE"
    for field in (*order, "unknown"):
        yield field, json.dumps(order | {field: mark}).replace(f'"{mark}"', hostile)
        yield field, json.dumps(order | {field: {"inner": [mark]}}).replace(f'"{mark}"', hostile)


def test_every_route_that_takes_a_document_is_strict() -> None:
    routes = routes_with_a_document()
    assert [route.path for route in routes if not isinstance(route, StrictRoute)] == []
    assert ORDERS.keys() <= {route.path for route in routes}


@pytest.mark.parametrize("hostile", HOSTILE)
def test_a_hostile_document_is_refused_with_its_place_and_poisons_no_list(team: Caller, hostile: str) -> None:
    for path, order in ORDERS.items():
        for field, text in documents(order, HOSTILE[hostile]):
            answer = team.post(
                path.format(name="mine"), content=text, headers={"content-type": "application/json"}
            )  # fmt: skip
            assert_problem(answer, 422)
            fault, detail = answer.json()["errors"][0], answer.json()["detail"]
            assert field in fault["where"] or "nesting" in detail or "values in all" in detail, answer.text
    for path in LISTS:
        listed = team.get(path)
        assert listed.status_code == 200, (path, listed.text)
        assert "inner" not in listed.text


@pytest.mark.parametrize("charset", ["utf-7", "unicode_escape", "raw_unicode_escape", "utf-16"])
@pytest.mark.parametrize("value", [b"+2AA-", rb"\ud800", rb"\x00", b"\x1b"])
def test_form_fields_cannot_smuggle_them_in_by_another_charset(team: Caller, charset: str, value: bytes) -> None:
    head = b'--b\r\ncontent-disposition: form-data; name="%s"%s\r\n\r\n'
    parts = [head % (b"name", b"") + b"my-town", head % (b"licence", b"") + value]
    parts.append(head % (b"file", b'; filename="a.net.xml"') + b"<net/>")
    body = b"\r\n".join(parts) + b"\r\n--b--\r\n"
    media = f"multipart/form-data; boundary=b; charset={charset}"
    answer = team.post("/v1/networks", content=body, headers={"content-type": media})
    assert answer.status_code in (202, 400, 422), answer.text
    assert team.get("/v1/networks").status_code == 200


@pytest.mark.parametrize("hostile", HOSTILE)
def test_the_spec_of_an_upload_is_as_strict(team: Caller, hostile: str) -> None:
    spec = json.dumps({"track": "map", "settings": {"x": "HOSTILE"}}).replace('"HOSTILE"', HOSTILE[hostile])
    answer = team.client.post(
        "/v1/agents/mine/submissions/onnx", data={"spec": spec}, files={"file": b"x"}, headers=team.headers
    )
    words = {"deep lists": "nesting", "deep objects": "nesting", "thousands of values": "values in all"}
    assert_problem(answer, 422, words.get(hostile, "settings.x"))


@pytest.mark.parametrize("hostile", HOSTILE)
def test_a_worker_cannot_send_them_either(team: Caller, hostile: str) -> None:
    for field in ("agent", "capacity", "version"):
        text = json.dumps({"agent": "mine", field: "HOSTILE"}).replace('"HOSTILE"', HOSTILE[hostile])
        answer = team.post("/v1/workers", content=text, headers={"content-type": Format.JSON})
        assert answer.status_code in (404, 413, 422), answer.text


@pytest.mark.parametrize("sensors", [["speedometer", "speedometer"], ["route", "speedometer", "route"]])
def test_a_sensor_is_taken_once(team: Caller, sensors: list[str]) -> None:
    order = {"kind": "remote", "sensors": sensors}
    assert_problem(team.post("/v1/agents/mine/submissions", order), 422, "expected each sensor once")


def test_a_caller_without_a_token_sends_short_bodies_only(team: Caller) -> None:
    long = b" " * (ANONYMOUS_BYTES + 1)
    for path in ("/v1/rescore", "/v1/invitations/redeem", "/login", "/join"):
        refused = team.client.post(path, content=long, headers={"content-type": "application/json"})
        assert_problem(refused, 413, f"{ANONYMOUS_BYTES} bytes")
    document = {"content-type": "application/json"}
    assert_problem(team.client.post("/v1/agents", content=long, headers=document), 401)
    assert team.post("/v1/rescore", content=long, headers=document).status_code == 422


def test_the_longest_rules_of_an_organiser_pass(team: Caller) -> None:
    rules = "\U0001f600" * 100_000  # twelve bytes each
    answer = team.post(
        "/v1/challenges",
        content=json.dumps({"name": "long", "title": "Long", "rules": rules}),
        headers={"content-type": "application/json"},
    )
    assert answer.status_code == 201, answer.text


@pytest.mark.parametrize("field", ["missions", "events", "obstacles"])
def test_of_thousands_of_wrong_items_the_first_is_told(team: Caller, field: str) -> None:
    answer = team.post("/v1/worlds", {"network": "ingolstadt", field: ["wrong"] * 10_000})
    assert_problem(answer, 422)
    assert {one["where"] for one in answer.json()["errors"]}.isdisjoint({f"body.{field}.1"})
    assert len(answer.json()["errors"]) <= 2


def test_values_are_counted_outside_of_texts() -> None:
    assert parse_json(json.dumps([',"[{\\' * 10_000] * 3)) == [',"[{\\' * 10_000] * 3
    assert len(parse_json(json.dumps(["a,b"] * (MOST_VALUES - 1)))) == MOST_VALUES - 1
    assert len(parse_json(json.dumps([{"a\\": '"'}] * (MOST_VALUES // 2 - 1)))) == MOST_VALUES // 2 - 1
    for many in ([0] * MOST_VALUES, [{"a": "b"}] * (MOST_VALUES // 2), ['\\"'] * MOST_VALUES, [[]] * MOST_VALUES):
        with pytest.raises(JsonError, match="values in all"):
            parse_json(json.dumps(many))


def test_plain_documents_are_what_pythons_parser_reads() -> None:
    text = '{"a": [1, -2.5e3, true, null, "é\\n\\ud83d\\ude00"], "": {"b": {}}, "big": 9223372036854775807}'
    assert parse_json(text) == json.loads(text)
    assert parse_json("[" * DEEPEST + "]" * DEEPEST)
    assert len(parse_json("{" + ",".join(f'"{n}": 0' for n in range(MOST_KEYS)) + "}")) == MOST_KEYS


@pytest.mark.parametrize("text", ["", "{", "{'a': 1}", "[1,]", b"\xff\xfe", b'"\xed\xa0\x80"', "nul"])
def test_what_is_no_json_is_said_so(text: str | bytes) -> None:
    with pytest.raises(JsonError, match="the document: expected"):
        parse_json(text)


def test_a_text_of_a_worker_is_kept_readable() -> None:
    assert readable("line\n\x1b[31mred\x00\ud800") == "line\n\ufffd[31mred\ufffd\ufffd"
