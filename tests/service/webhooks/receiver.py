"""Who is called by webhooks, and what became of the calls."""

from __future__ import annotations

import contextlib
import socket
import ssl
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from sqlalchemy import select

from dohyo.service.webhooks import queries as webhooks
from dohyo.service.webhooks.model import Delivery
from tests.service.harness import Harness

PATIENCE_S = 120.0


class Receiver:
    """A web server that notes what it gets, and answers as it is told."""

    def __init__(self, tls: ssl.SSLContext | None = None) -> None:
        self.got: list[tuple[dict[str, str], bytes]] = []
        self.answers = [200]
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["content-length"]))
                outer.got.append(({key.lower(): value for key, value in self.headers.items()}, body))
                status = outer.answers.pop(0) if len(outer.answers) > 1 else outer.answers[0]
                self.send_response(status)
                if status in (301, 302, 307):
                    self.send_header("location", f"http://127.0.0.1:{outer.port}/elsewhere")
                self.end_headers()

            def log_message(self, *_: Any) -> None:
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.port = self.server.server_address[1]
        if tls is not None:
            self.server.socket = tls.wrap_socket(self.server.socket, server_side=True)
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def close(self) -> None:
        self.server.shutdown()
        self.server.server_close()

    def wait(self, count: int) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while len(self.got) < count:
            assert time.monotonic() < deadline, f"got {len(self.got)} of {count}"
            time.sleep(0.01)


class Dripping:
    """A server that answers every connection with a byte of a header, again and again.

    The answers begin in several ways, in turn.
    """

    def __init__(self, *begins: bytes) -> None:
        self.connections: list[socket.socket] = []
        self._begins = begins
        self._listener = socket.create_server(("127.0.0.1", 0), backlog=64)
        self.port = self._listener.getsockname()[1]
        self._stop = threading.Event()
        self._threads = [threading.Thread(target=one) for one in (self._accept, self._drip)]

    def _accept(self) -> None:
        self._listener.settimeout(0.1)
        while not self._stop.is_set():
            try:
                one = self._listener.accept()[0]
                one.send(self._begin_of(len(self.connections)))
                self.connections.append(one)
            except OSError:
                continue

    def _drip(self) -> None:
        while not self._stop.wait(0.05):
            for number, one in enumerate(list(self.connections)):
                with contextlib.suppress(OSError):
                    one.send(b"x" if self._begin_of(number) else b"H")

    def _begin_of(self, number: int) -> bytes:
        return self._begins[number % len(self._begins)]

    def __enter__(self) -> Dripping:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()
        for one in (self._listener, *self.connections):
            one.close()

    def wait(self, count: int) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while len(self.connections) < count:
            assert time.monotonic() < deadline, f"{len(self.connections)} of {count} connections"
            time.sleep(0.01)


def deliveries(service: Harness) -> list[Delivery]:
    with service.services.database.reading() as session:
        return list(session.scalars(select(Delivery).order_by(Delivery.id)))


def settled(service: Harness) -> list[Delivery]:
    """Deliveries once nothing more will be tried."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        found = deliveries(service)
        if found and all(one.delivered or one.attempts >= webhooks.ATTEMPTS for one in found):
            return found
        assert time.monotonic() < deadline, [(one.attempts, one.failure) for one in found]
        time.sleep(0.02)
