"""Waiting for the end of evaluations and jobs: events first, then polling, as fast as the service asks for it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from dohyo.service.client import client as blocking
from dohyo.service.client.client import Client
from dohyo.service.client.errors import ServiceError
from tests.service.client.scripted import BROKEN, Answer, Script, serving

EVENTS = "/v1/evaluations/ev-1/progress"
SOON = {"retry-after": "0"}


def state(status: str) -> dict[str, Any]:
    return {"id": "ev-1", "status": status}


def event(name: str, document: dict[str, Any], identifier: str = "") -> str:
    return (
        f"retry: 0\nevent: {name}\n"
        + (f"id: {identifier}\n" if identifier else "")
        + f"data: {json.dumps(document)}\n\n"
    )


@pytest.fixture
def script() -> Iterator[Script]:
    with serving() as script:
        yield script


@pytest.fixture
def client(script: Script) -> Iterator[Client]:
    with Client(script.url) as client:
        yield client


def test_a_broken_stream_is_continued_where_it_broke(script: Script, client: Client) -> None:
    script.answers += [
        Answer(event("state", state("running"), "7") + "event: end\ndata: {half"),
        Answer(state("running")),
        Answer(": a comment\n\n" + event("episode", {"episode": "ep-1"}, "8")),
        Answer(state("running")),
        Answer(state("running")),
        Answer(event("end", state("done"), "end")),
    ]
    assert [one["status"] for one in client.follow("ev-1")] == ["running"] * 4 + ["done"]
    assert [last for path, last in script.asked if path == f"GET {EVENTS}"] == ["", "7", "8"]


def test_without_streams_it_polls_as_the_service_asks(script: Script, client: Client) -> None:
    full = Answer({"detail": "at most 32 open event streams"}, 429, SOON)
    script.answers += [
        full,
        Answer({"detail": "busy"}, 503, SOON),
        Answer(state("running")),
        full,
        Answer(state("done")),
    ]
    assert client.wait("ev-1")["status"] == "done"
    assert [path.rpartition("/")[2] for path, _ in script.asked] == ["progress", "ev-1", "ev-1", "progress", "ev-1"]


def test_a_time_limit_ends_the_wait(script: Script, client: Client) -> None:
    script.answers += [Answer(state("running"))]
    with pytest.raises(TimeoutError, match="has not ended in 0 s"):
        client.wait("ev-1", timeout_s=0.0)


def test_orders_become_jobs_whose_end_is_told_by_events(script: Script, client: Client) -> None:
    job = {"id": "job-1", "status": "queued", "failure": None, "answer": None}
    location = {"location": "http://elsewhere.example/v1/jobs/job-1"}
    ended = job | {"status": "done", "answer": {"version": 3}}
    script.answers += [Answer(job, 202, location), Answer(event("end", ended, "end"))]
    assert client.submit_builtin("mine", "autopilot") == {"version": 3}
    script.answers += [Answer(job, 202, location), Answer(event("end", ended, "end")), Answer({"explanations": {}})]
    assert client.get("/v1/episodes/ep-1/explanation", tick=0) == {"explanations": {}}
    failed = job | {"status": "failed", "failure": {"status": 422, "detail": "no such entry"}}
    script.answers += [Answer(job, 202, location), Answer(event("end", failed, "end"))]
    with pytest.raises(ServiceError, match=r"no such entry \(HTTP 422\)"):
        client.submit_builtin("mine", "none")
    assert [path for path, _ in script.asked[1::2]][:1] == ["GET /v1/jobs/job-1/events"]


def test_a_refusal_that_asks_for_much_patience_is_an_error(script: Script, client: Client) -> None:
    script.answers += [Answer({"detail": "5 runs a day"}, 429, {"retry-after": "7200"})]
    with pytest.raises(ServiceError) as refused:
        client.evaluate("mine", "quickstart", ranked=True)
    assert (refused.value.status, refused.value.retry_s) == (429, 7200.0)
    script.answers += [Answer({"detail": "the queue is full"}, 503, SOON)]
    with pytest.raises(ServiceError, match="queue is full"):
        client.evaluate("mine", "quickstart")


def test_a_restart_of_the_service_does_not_end_the_wait(
    script: Script, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(blocking, "POLL_S", 0.01)
    away = [Answer({}, status) for status in (502, 503, 504)]
    script.answers += [Answer(event("state", state("running"), "7")), BROKEN, *away, Answer(state("running"))]
    script.answers += [BROKEN, BROKEN, Answer(state("done"))]
    assert [one["status"] for one in client.follow("ev-1")] == ["running", "running", "done"]


def test_a_service_that_stays_away_ends_the_wait(script: Script, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocking, "POLL_S", 0.01)
    script.answers += [BROKEN, Answer({"detail": "no such evaluation"}, 404)]
    with Client(script.url) as client, pytest.raises(ServiceError, match="no such evaluation"):
        client.wait("ev-1")
    script.answers += [BROKEN, Answer({}, 502)]
    with Client(script.url, patience_s=0.0) as client, pytest.raises(ServiceError, match="HTTP 502"):
        client.wait("ev-1")


def test_what_only_reads_is_asked_again_while_a_proxy_answers_for_the_service(
    script: Script, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(blocking, "POLL_S", 0.01)
    script.answers += [*(Answer("<html>away</html>", status) for status in (502, 503, 504)), Answer(state("done"))]
    assert client.evaluation("ev-1")["status"] == "done"
    script.answers += [Answer({}, 502)]
    with pytest.raises(ServiceError, match="HTTP 502"):
        client.cancel("ev-1")  # an order may have had its effect
    script.answers += [Answer({"detail": "a fault of the service"}, 500)]
    with pytest.raises(ServiceError, match="HTTP 500"):
        client.evaluation("ev-1")


def test_no_read_is_asked_again_after_its_time(script: Script, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocking, "POLL_S", 60.0)
    script.answers += [Answer({}, 502), Answer({}, 502)]
    with Client(script.url, patience_s=10.0) as client, pytest.raises(ServiceError, match="HTTP 502"):
        client.evaluation("ev-1")
    with Client(script.url) as client, pytest.raises(ServiceError, match="HTTP 502"):
        client.wait("ev-1", timeout_s=10.0)
