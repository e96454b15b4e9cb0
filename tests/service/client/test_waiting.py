"""Waiting for the end of evaluations and jobs: events first, then polling, as fast as the service asks for it."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from dohyo.service.client.client import Client
from dohyo.service.client.errors import ServiceError

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


@dataclass(frozen=True)
class Answer:
    """An answer; a text is a stream of events, which closes after it."""

    body: str | dict[str, Any]
    status: int = 200
    headers: dict[str, str] = field(default_factory=dict)


class Scripted(BaseHTTPRequestHandler):
    """Gives the next answer of a script, and notes the request."""

    def __init__(self, script: list[Answer], asked: list[tuple[str, str]], *arguments: Any) -> None:
        self.script, self.asked = script, asked
        super().__init__(*arguments)

    def answer(self) -> None:
        self.rfile.read(int(self.headers.get("content-length", 0)))
        self.asked.append((f"{self.command} {self.path}", self.headers.get("last-event-id", "")))
        answer = self.script.pop(0)
        text = isinstance(answer.body, str)
        content = (answer.body if text else json.dumps(answer.body)).encode()  # type: ignore[union-attr]
        self.send_response(answer.status)
        self.send_header("content-type", "text/event-stream" if text else "application/json")
        self.send_header("content-length", str(len(content)))
        for name, value in answer.headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def do_GET(self) -> None:
        self.answer()

    def do_POST(self) -> None:
        self.answer()

    def log_message(self, *_: Any) -> None:
        """Silent."""


@dataclass
class Script:
    """A server that follows a script."""

    client: Client
    answers: list[Answer]
    asked: list[tuple[str, str]]


@pytest.fixture
def script() -> Iterator[Script]:
    answers: list[Answer] = []
    asked: list[tuple[str, str]] = []
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Scripted, answers, asked))
    thread = threading.Thread(target=partial(server.serve_forever, poll_interval=0.01))
    thread.start()
    with Client(f"http://127.0.0.1:{server.server_port}") as client:
        yield Script(client, answers, asked)
    server.shutdown()
    thread.join()
    server.server_close()
    assert answers == []


def test_a_broken_stream_is_continued_where_it_broke(script: Script) -> None:
    script.answers += [
        Answer(event("state", state("running"), "7") + "event: end\ndata: {half"),
        Answer(state("running")),
        Answer(": a comment\n\n" + event("episode", {"episode": "ep-1"}, "8")),
        Answer(state("running")),
        Answer(state("running")),
        Answer(event("end", state("done"), "end")),
    ]
    assert [one["status"] for one in script.client.follow("ev-1")] == ["running"] * 4 + ["done"]
    assert [last for path, last in script.asked if path == f"GET {EVENTS}"] == ["", "7", "8"]


def test_without_streams_it_polls_as_the_service_asks(script: Script) -> None:
    full = Answer({"detail": "at most 32 open event streams"}, 429, SOON)
    script.answers += [
        full,
        Answer({"detail": "busy"}, 503, SOON),
        Answer(state("running")),
        full,
        Answer(state("done")),
    ]
    assert script.client.wait("ev-1")["status"] == "done"
    assert [path.rpartition("/")[2] for path, _ in script.asked] == ["progress", "ev-1", "ev-1", "progress", "ev-1"]


def test_a_time_limit_ends_the_wait(script: Script) -> None:
    script.answers += [Answer(state("running"))]
    with pytest.raises(TimeoutError, match="has not ended in 0 s"):
        script.client.wait("ev-1", timeout_s=0.0)


def test_orders_become_jobs_whose_end_is_told_by_events(script: Script) -> None:
    job = {"id": "job-1", "status": "queued", "failure": None, "answer": None}
    location = {"location": "http://elsewhere.example/v1/jobs/job-1"}
    ended = job | {"status": "done", "answer": {"version": 3}}
    script.answers += [Answer(job, 202, location), Answer(event("end", ended, "end"))]
    assert script.client.submit_builtin("mine", "autopilot") == {"version": 3}
    script.answers += [Answer(job, 202, location), Answer(event("end", ended, "end")), Answer({"explanations": {}})]
    assert script.client.get("/v1/episodes/ep-1/explanation", tick=0) == {"explanations": {}}
    failed = job | {"status": "failed", "failure": {"status": 422, "detail": "no such entry"}}
    script.answers += [Answer(job, 202, location), Answer(event("end", failed, "end"))]
    with pytest.raises(ServiceError, match=r"no such entry \(HTTP 422\)"):
        script.client.submit_builtin("mine", "none")
    assert [path for path, _ in script.asked[1::2]][:1] == ["GET /v1/jobs/job-1/events"]


def test_a_refusal_that_asks_for_much_patience_is_an_error(script: Script) -> None:
    script.answers += [Answer({"detail": "5 runs a day"}, 429, {"retry-after": "7200"})]
    with pytest.raises(ServiceError) as refused:
        script.client.evaluate("mine", "quickstart", ranked=True)
    assert (refused.value.status, refused.value.retry_s) == (429, 7200.0)
    script.answers += [Answer({"detail": "the queue is full"}, 503, SOON)]
    with pytest.raises(ServiceError, match="queue is full"):
        script.client.evaluate("mine", "quickstart")
