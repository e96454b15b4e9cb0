"""A server by hand, which gives the answers of a script one after another."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


@dataclass(frozen=True)
class Answer:
    """An answer; a text is a stream of events, which closes after it."""

    body: str | dict[str, Any]
    status: int = 200
    headers: dict[str, str] = field(default_factory=dict)


BROKEN = Answer("", 0)
"""The connection is closed without an answer, after the request was read."""


@dataclass
class Script:
    """A server that follows a script.

    Attributes:
        answers: Those to come.
        asked: Requests so far, each with its header `Last-Event-ID`.
        bodies: Bodies of those requests.
        keys: Their headers `Idempotency-Key`; "" where there was none.
    """

    answers: list[Answer] = field(default_factory=list)
    asked: list[tuple[str, str]] = field(default_factory=list)
    bodies: list[bytes] = field(default_factory=list)
    keys: list[str] = field(default_factory=list)
    url: str = ""


class Scripted(BaseHTTPRequestHandler):
    """Gives the next answer of a script, and notes the request."""

    def __init__(self, script: Script, *arguments: Any) -> None:
        self.script = script
        super().__init__(*arguments)

    def answer(self) -> None:
        self.script.bodies.append(self.rfile.read(int(self.headers.get("content-length", 0))))
        self.script.asked.append((f"{self.command} {self.path}", self.headers.get("last-event-id", "")))
        self.script.keys.append(self.headers.get("idempotency-key", ""))
        answer = self.script.answers.pop(0)
        if answer == BROKEN:
            self.close_connection = True
            return
        text = isinstance(answer.body, str)
        content = (answer.body if text else json.dumps(answer.body)).encode()  # type: ignore[union-attr]
        self.send_response(answer.status)
        if "content-type" not in answer.headers:
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

    def do_DELETE(self) -> None:
        self.answer()

    def log_message(self, *_: Any) -> None:
        """Silent."""


@contextmanager
def serving() -> Iterator[Script]:
    """A server; all answers of its script must have been given in the end."""
    script = Script()
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Scripted, script))
    thread = threading.Thread(target=partial(server.serve_forever, poll_interval=0.01))
    thread.start()
    script.url = f"http://127.0.0.1:{server.server_port}"
    try:
        yield script
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
    assert script.answers == []
