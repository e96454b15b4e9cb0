"""Connections: attacks with slow ones, on sockets; and each limit by itself, on a bare application."""

from __future__ import annotations

import json
import selectors
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
import uvicorn

from dohyo.service.monitoring.metrics import Metrics
from dohyo.service.web.connections import ConnectionLimits, Connections, Loop, protocol
from tests.service.served import wait_until
from tests.service.serving import Served, serving

ATTACKERS, ROOM = 1500, 1000
PATIENCE_S = 60.0
STANDSTILL_S = 1.0
# A slow request may take ten minutes: each answer of this test comes while those are open.
FEW_AND_PATIENT = f"""
import os, dohyo.service.server as server
from functools import partial
os.environ |= {{"DOHYO_CONNECTIONS": "{ROOM}", "DOHYO_TRUSTED_PROXIES": ""}}
server.ConnectionLimits = partial(server.ConnectionLimits, header_s=600.0, body_s=600.0)
"""


class Dripping:
    """Many connections that send a byte each, again and again, from several addresses of this machine."""

    def __init__(self, url: str, begin: Callable[[int], bytes]) -> None:
        target = urlsplit(url)
        self.open: list[socket.socket] = []
        for number in range(ATTACKERS):
            one = socket.create_connection(
                (target.hostname, target.port), source_address=(f"127.0.0.{2 + number % 8}", 0)
            )
            one.setblocking(False)
            one.send(begin(number))
            self.open.append(one)

    def drip(self) -> int:
        """Sends a byte more on each; returns how many are left."""
        for one in list(self.open):
            try:
                one.send(b"x")
                if not one.recv(1000):
                    raise ConnectionResetError
            except BlockingIOError:
                continue
            except OSError:
                self.open.remove(one)
                one.close()
        return len(self.open)

    def close(self) -> None:
        for one in self.open:
            one.close()


def headers(number: int) -> bytes:
    return b"GET /v1/agents HTTP/1.1\r\nhost: x\r\nx-slow: "


def bodies(number: int) -> bytes:
    return (
        b"POST /v1/evaluations HTTP/1.1\r\nhost: x\r\ncontent-type: application/json\r\ncontent-length: 90000\r\n\r\n"
    )


def silence(number: int) -> bytes:
    return b""


def mixed(number: int) -> bytes:
    return (headers, bodies, silence)[number % 3](number)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with serving(tmp_path_factory.mktemp("data"), before=FEW_AND_PATIENT) as one:
        yield one


@pytest.mark.slow
@pytest.mark.parametrize("begin", [headers, bodies, mixed])
def test_1500_slow_connections_keep_nobody_out(served: Served, begin: Callable[[int], bytes]) -> None:
    attack = Dripping(served.url, begin)
    stop = threading.Event()

    def drip() -> None:
        while not stop.wait(0.2):
            attack.drip()

    dripping = threading.Thread(target=drip)
    dripping.start()
    try:
        for _ in range(5):
            assert httpx.get(f"{served.url}/health/live", timeout=60).status_code == 200
            served.ask("GET", "/v1/me")
        wait_until(lambda: len(attack.open) <= ROOM, "more connections are open than may be")
        assert len(attack.open) > 0.8 * ROOM, "the slow ones have ended; the test shows nothing"
    finally:
        stop.set()
        dripping.join()
        attack.close()
    wait_until(lambda: any("a newer one" in line.get("reason", "") for line in served.log), "the log does not name it")
    (line, *_) = (line for line in served.log if "a newer one" in line.get("reason", ""))
    assert line["most_from"].startswith("127.0.0.")
    errors = [line for line in served.log if line["level"] == "error"]
    assert not errors, errors[:2]


async def echo(scope: Any, receive: Any, send: Any) -> None:
    """Reads the body, and answers its length; or answers what the path asks for."""
    length, more = 0, scope["path"] != "/unread-body"
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            return
        length += len(message["body"])
        more = message["more_body"]
    if scope["path"] == "/standstill":
        time.sleep(STANDSTILL_S)
    await send({"type": "http.response.start", "status": 200, "headers": []})
    if scope["path"] == "/long":
        for _ in range(1000):
            await send({"type": "http.response.body", "body": b"x" * 100_000, "more_body": True})
    await send({"type": "http.response.body", "body": json.dumps(length).encode()})


@contextmanager
def limited(*, keep_alive_s: float = 5.0, **limits: Any) -> Iterator[int]:
    """The port of a bare application with these limits, and this time between two requests, s."""
    given = {"header_s": 1.0, "body_s": 1.0, "unread_s": 0.3} | limits
    server = uvicorn.Server(
        uvicorn.Config(
            echo,
            port=0,
            lifespan="off",
            log_config=None,
            timeout_keep_alive=keep_alive_s,  # type: ignore[arg-type]
            loop=f"{Loop.__module__}:Loop",
            http=protocol(Connections(ConnectionLimits(**given), Metrics())),
        )
    )
    thread = threading.Thread(target=server.run)
    thread.start()
    wait_until(lambda: server.started, "it does not start")
    try:
        yield server.servers[0].sockets[0].getsockname()[1]
    finally:
        server.should_exit = True
        thread.join()


def connect(port: int, address: str = "127.0.0.1") -> socket.socket:
    one = socket.create_connection(("127.0.0.1", port), source_address=(address, 0))
    one.settimeout(PATIENCE_S)
    return one


def read(one: socket.socket) -> bytes:
    """All until the end of the connection."""
    got = b""
    try:
        while piece := one.recv(100_000):
            got += piece
    except ConnectionResetError:
        pass
    return got


def read_answer(one: socket.socket) -> bytes:
    """One answer in chunks, to its last: it may come in several pieces."""
    got = b""
    while not got.endswith(b"\r\n0\r\n\r\n"):
        piece = one.recv(10_000)
        assert piece, got
        got += piece
    return got


def drip_until_the_end(one: socket.socket, pieces: bytes) -> bytes:
    """Sends a piece every 50 ms until the other side ends the connection; returns what it said."""
    with selectors.DefaultSelector() as selector:
        selector.register(one, selectors.EVENT_READ)
        for _ in range(int(PATIENCE_S / 0.05)):
            if selector.select(0.05):
                return read(one)
            one.send(pieces)
    raise AssertionError("the connection goes on")


SLOW_REQUESTS = {
    "empty-lines": (b"", b"\r\n"),
    "headers": (b"GET / HTTP/1.1\r\nx: ", b"x"),
    "body": (b"POST / HTTP/1.1\r\ncontent-length: 100000\r\n\r\n", b"x"),
    "chunks": (b"POST / HTTP/1.1\r\ntransfer-encoding: chunked\r\n\r\n", b"1\r\nx\r\n"),
}


@pytest.mark.parametrize(("begin", "piece"), SLOW_REQUESTS.values(), ids=SLOW_REQUESTS)
@pytest.mark.parametrize("answered_before", [False, True])
def test_a_slow_request_has_limited_time(begin: bytes, piece: bytes, answered_before: bool) -> None:
    with limited() as port, connect(port) as one:
        if answered_before:
            one.send(b"GET / HTTP/1.1\r\n\r\n")
            assert b"200 OK" in read_answer(one)
        one.send(begin)
        assert drip_until_the_end(one, piece).startswith(b"HTTP/1.1 408")


def test_a_connection_that_never_sends_a_byte_has_limited_time() -> None:
    with limited() as port, connect(port) as one:
        assert read(one).startswith(b"HTTP/1.1 408")


def test_a_silent_connection_after_an_answer_has_the_time_between_requests() -> None:
    with limited(header_s=PATIENCE_S, keep_alive_s=0.3) as port, connect(port) as one:
        one.send(b"GET / HTTP/1.1\r\n\r\n")
        answer = read(one)
        assert b"200 OK" in answer
        assert b"408" not in answer


def test_a_long_body_that_comes_fast_enough_is_read_to_its_end() -> None:
    """4 s of body are more than the time that a body has without its bytes."""
    with limited(body_s=3.0, body_rate=1000.0) as port, connect(port) as one:
        one.send(b"POST / HTTP/1.1\r\ncontent-length: 20000\r\nconnection: close\r\n\r\n")
        pause = threading.Event()
        for _ in range(20):
            one.send(b"x" * 1000)
            pause.wait(0.2)
        assert read(one).endswith(b"20000\r\n0\r\n\r\n")


def test_bytes_that_came_fast_allow_no_standstill_afterwards() -> None:
    """By its mean rate this body might stand still for 100 s."""
    with limited(body_rate=1000.0) as port, connect(port) as one:
        one.send(b"POST / HTTP/1.1\r\ncontent-length: 200000\r\n\r\n" + b"x" * 100_000)
        began = time.monotonic()
        assert read(one).startswith(b"HTTP/1.1 408")
        assert time.monotonic() - began < 20.0


def test_headers_that_never_end_are_cut_off() -> None:
    with limited(header_s=PATIENCE_S) as port, connect(port) as one:
        one.send(b"GET / HTTP/1.1\r\n")
        answer = b""
        try:
            for number in range(100):
                one.send(b"x-%d: " % number + b"x" * 10_000 + b"\r\n")
        except OSError:
            pass
        answer = read(one)
        assert answer.startswith(b"HTTP/1.1 431") or answer == b""


def test_an_answer_that_is_not_read_ends() -> None:
    with limited() as port, connect(port) as one:
        one.send(b"GET /long HTTP/1.1\r\n\r\n")
        threading.Event().wait(3.0)
        assert len(read(one)) < 100_000_000


def test_a_body_that_nobody_reads_leaves_no_connection_behind() -> None:
    with limited() as port, connect(port) as one:
        one.send(b"POST /unread-body HTTP/1.1\r\ncontent-length: 1000\r\n\r\n")
        assert b"200 OK" in read_answer(one)
        drip_until_the_end(one, b"x")


def test_a_full_server_closes_what_is_of_least_use_first() -> None:
    with limited(total=8, keep_alive_s=PATIENCE_S, header_s=PATIENCE_S, body_s=PATIENCE_S) as port:
        idle = connect(port)
        idle.send(b"GET / HTTP/1.1\r\n\r\n")
        assert b"200 OK" in read_answer(idle)
        body = connect(port)
        body.send(b"POST / HTTP/1.1\r\ncontent-length: 10\r\nexpect: 100-continue\r\n\r\n")
        assert b"100 Continue" in body.recv(10_000), "its headers have not come, so that it would be closed, too"
        slow = [connect(port) for _ in range(6)]
        for one in slow:
            one.send(b"GET / HTTP/1.1\r\n")
        new = [connect(port) for _ in range(6)]
        for one in new:
            one.send(b"POST / HTTP/1.1\r\ncontent-length: 10\r\n\r\n")
        assert [read(one) for one in slow] == [b""] * 6
        newest = connect(port)
        newest.send(b"GET / HTTP/1.1\r\nconnection: close\r\n\r\n")
        assert read(newest).endswith(b"\r\n0\r\n0\r\n\r\n") or b"200 OK" in read(newest)
        for one in (idle, body, newest, *slow, *new):
            one.close()


def test_of_connections_that_come_at_once_the_oldest_are_closed_first() -> None:
    with limited(total=7, keep_alive_s=PATIENCE_S, header_s=PATIENCE_S) as port:
        busy = connect(port)
        busy.send(b"GET /standstill HTTP/1.1\r\n\r\n")
        time.sleep(STANDSTILL_S / 2)  # the server accepts nothing in the meantime, and then all of them
        old, new = ([connect(port) for _ in range(6)] for _ in range(2))
        assert [read(one) for one in old] == [b""] * 6
        for one in new:
            one.send(b"GET / HTTP/1.1\r\nconnection: close\r\n\r\n")
        assert all(b"200 OK" in read(one) for one in new)
        for one in (busy, *old, *new):
            one.close()


def test_one_address_takes_no_connection_of_another() -> None:
    with limited(per_address=4, header_s=PATIENCE_S) as port:
        other = connect(port, "127.0.0.9")
        other.send(b"GET / HTTP/1.1\r\n")
        many = [connect(port) for _ in range(20)]
        with selectors.DefaultSelector() as selector:
            for one in many:
                selector.register(one, selectors.EVENT_READ)
            wait_until(lambda: len(selector.select(0)) == 16, "not all but four are closed")
        other.send(b"connection: close\r\n\r\n")
        assert b"200 OK" in read(other)
        for one in many:
            one.close()


def test_a_proxy_brings_as_many_connections_as_it_likes() -> None:
    with limited(per_address=4, header_s=PATIENCE_S, proxies=("127.0.0.0/8",)) as port:
        many = [connect(port) for _ in range(20)]
        for one in many:
            one.send(b"GET / HTTP/1.1\r\nconnection: close\r\n\r\n")
        assert all(b"200 OK" in read(one) for one in many)
