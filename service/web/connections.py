"""Connections: time limits for slow ones, and room for new ones when many are open.

uvicorn limits only the time between two requests, and refuses everybody alike beyond a number of connections. Here a
client has limited time for the headers of a request, a lowest rate for its body and for reading the answer. Where too
many connections are open, of one address or of all, a new one takes the place of the one that is of least use: first
those that never finished their headers, then idle ones, then the slowest bodies. A request that is being answered is
never cut off for room.
"""

from __future__ import annotations

import asyncio
import heapq
import ipaddress
import itertools
import logging
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

import uvloop
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from dohyo.service.monitoring.metrics import Metrics
from dohyo.service.web.addresses import client_of

LOG_S: Final = 1.0  # time over which closed connections are counted into one line of the log
MOST_HEADER_BYTES: Final = 64 * 1024
_REFUSED: Final = (
    b"HTTP/1.1 503 Service Unavailable\r\nretry-after: 5\r\nconnection: close\r\ncontent-length: 0\r\n\r\n"
)
_TOO_LATE: Final = b"HTTP/1.1 408 Request Timeout\r\nconnection: close\r\ncontent-length: 0\r\n\r\n"
_TOO_LONG: Final = b"HTTP/1.1 431 Request Header Fields Too Large\r\nconnection: close\r\ncontent-length: 0\r\n\r\n"

logger = logging.getLogger("dohyo.service")


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """Limits of connections.

    Attributes:
        total: Most open connections.
        per_address: Most open connections of one address, an IPv6 network of 64 bits counting as one.
        proxies: Addresses and networks that have no limit of their own.
        header_s: Longest time for the headers of a request, s.
        body_s: Longest time without any byte of a body, s. A slow one uses it up, and each byte gives some of it back.
        body_rate: Rate of a body at which this time neither falls nor grows, bytes/s.
        unread_s: Longest time in which a client reads nothing of its answer, s.
    """

    total: int = 2000
    per_address: int = 256
    proxies: Collection[str] = ()
    header_s: float = 10.0
    body_s: float = 20.0
    body_rate: float = 500.0
    unread_s: float = 60.0


class Phase(IntEnum):
    """What a connection waits for; the lower, the sooner it is closed for room."""

    HEADERS = 0
    IDLE = 1
    BODY = 2
    ANSWER = 3


class Connections:
    """All open connections of a server."""

    def __init__(self, limits: ConnectionLimits, metrics: Metrics) -> None:
        self.limits = limits
        self._refused = metrics.refused
        metrics.connections.set_function(lambda: self._count)
        self._proxies = tuple(ipaddress.ip_network(one, strict=False) for one in limits.proxies)
        self._open: dict[str, set[LimitedProtocol]] = {}
        self._count = 0
        self._closed: Counter[tuple[str, str]] = Counter()
        self._numbers = itertools.count()

    def number(self) -> int:
        """A number above that of every connection so far."""
        return next(self._numbers)

    def admit(self, new: LimitedProtocol) -> bool:
        """Counts a new connection, after it got the place of another one where none is free."""
        group = self._group(new.client[0] if new.client else "")
        siblings = self._open.setdefault(group, set())
        if group and len(siblings) >= self.limits.per_address and not self._make_room(siblings):
            self.note("too many connections of one address", new)
            return False
        if self._count >= self.limits.total and not self._make_room(set().union(*self._open.values())):
            self.note("too many connections", new)
            return False
        # The set may have been dropped with its last connection, which made room.
        self._open.setdefault(group, siblings).add(new)
        new.group = group
        self._count += 1
        return True

    def forget(self, gone: LimitedProtocol) -> None:
        """Removes a connection."""
        siblings = self._open.get(gone.group, set())
        if gone in siblings:
            siblings.discard(gone)
            self._count -= 1
        if not siblings:
            self._open.pop(gone.group, None)

    def note(self, reason: str, connection: LimitedProtocol) -> None:
        """Logs that a connection was refused or closed, together with others of about the same time."""
        if not self._closed:
            connection.loop.call_later(LOG_S, self._log)
        self._refused.labels(reason).inc()
        self._closed[reason, connection.client[0] if connection.client else ""] += 1

    def _log(self) -> None:
        closed, self._closed = self._closed, Counter()
        for reason in {reason for reason, _ in closed}:
            addresses = {address: count for (why, address), count in closed.most_common() if why == reason}
            facts = {"reason": reason, "count": sum(addresses.values()), "addresses": len(addresses)}
            logger.warning("connections closed", extra={"facts": facts | {"most_from": next(iter(addresses))}})

    def _make_room(self, among: Collection[LimitedProtocol]) -> bool:
        """Closes the connection of least use; among those without headers several, since the search costs time."""
        ordered = heapq.nsmallest(max(1, len(among) // 20), among, key=LimitedProtocol.use)
        if not ordered or ordered[0].phase is Phase.ANSWER:
            return False
        for useless in [one for one in ordered if one is ordered[0] or one.phase is Phase.HEADERS]:
            self.note(f"closed for a newer one, waiting for {useless.phase.name.lower()}", useless)
            self.forget(useless)
            useless.transport.abort()
        return True

    def _group(self, address: str) -> str:
        """What is counted as one address; empty for a proxy, which brings the connections of many."""
        try:
            parsed = ipaddress.ip_address(address)
        except ValueError:
            return ""
        return "" if any(parsed in network for network in self._proxies) else client_of(address)


class LimitedProtocol(HttpToolsProtocol):
    """A connection with time limits.

    Attributes:
        phase: What it waits for.
        group: What its address is counted as.
    """

    def __init__(self, connections: Connections, **given: Any) -> None:
        super().__init__(**given)
        self.phase = Phase.HEADERS
        self.group = ""
        self._connections, self._limits = connections, connections.limits
        self._number = connections.number()
        self._since = 0.0
        self._received = 0
        self._due = 0.0
        self._timer: asyncio.TimerHandle | None = None
        self._timed: Phase | None = None
        self._unread: asyncio.TimerHandle | None = None

    def use(self) -> tuple[int, float, int]:
        """Order in which connections are closed for room: by phase, then by age, or the time that a body still has.

        The loop's clock stands still while it accepts many at once, so that their number decides.
        """
        return self.phase, self._due if self.phase is Phase.BODY else self._since, self._number

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Counts the connection, and gives it time for its first headers."""
        super().connection_made(transport)
        self._enter(Phase.HEADERS)
        if self._connections.admit(self):
            self._set_timer()
        else:
            self._end(_REFUSED)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forgets the connection."""
        for timer in (self._timer, self._unread):
            if timer is not None:
                timer.cancel()
        self._timer = self._unread = None
        self._connections.forget(self)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Parses, and starts or ends the timer of the phase that this leads to."""
        super().data_received(data)
        self._received += len(data)
        if self.phase is Phase.BODY:
            self._due = min(self._due + len(data) / self._limits.body_rate, self.loop.time() + self._limits.body_s)
        if self.phase is Phase.IDLE:
            self._enter(Phase.HEADERS)  # bytes before a request, such as empty lines
        if self.phase is Phase.HEADERS and self._received > MOST_HEADER_BYTES:
            self._close("headers too long", _TOO_LONG)
        elif self._timed is not self.phase:
            self._set_timer()

    def on_message_begin(self) -> None:
        """A request begins."""
        super().on_message_begin()
        if self.phase is not Phase.HEADERS:
            self._enter(Phase.HEADERS)

    def on_headers_complete(self) -> None:
        """The body of a request begins."""
        self._enter(Phase.BODY)
        self._due = self._since + self._limits.body_s
        super().on_headers_complete()

    def on_message_complete(self) -> None:
        """A request has come."""
        super().on_message_complete()
        self._enter(Phase.IDLE if self.cycle.response_complete else Phase.ANSWER)

    def on_response_complete(self) -> None:
        """A request is answered."""
        super().on_response_complete()
        if self.phase is Phase.ANSWER and not self.pipeline:
            self._enter(Phase.IDLE)

    def pause_writing(self) -> None:
        """The client reads too slowly."""
        super().pause_writing()
        self._unread = self.loop.call_later(self._limits.unread_s, self._close, "answer not read")

    def resume_writing(self) -> None:
        """The client has read."""
        super().resume_writing()
        if self._unread is not None:
            self._unread.cancel()
            self._unread = None

    def _enter(self, phase: Phase) -> None:
        self.phase, self._received, self._timed = phase, 0, None
        self._since = self.loop.time()

    def _set_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._timed = self.phase
        if self.phase is Phase.HEADERS:
            self._timer = self.loop.call_later(self._limits.header_s, self._close, "headers too slow", _TOO_LATE)
        elif self.phase is Phase.BODY:
            self._timer = self.loop.call_later(self._limits.body_s, self._check_body)

    def _check_body(self) -> None:
        """Ends a body that is too slow; one that waits for the application is not."""
        if self.flow.read_paused or self.cycle.waiting_for_100_continue:
            self._due = self.loop.time() + self._limits.body_s
        wait = self._due - self.loop.time()
        if wait > 0:
            self._timer = self.loop.call_later(wait, self._check_body)
        else:
            self._close("body too slow", _TOO_LATE)

    def _close(self, reason: str, answer: bytes = b"") -> None:
        self._connections.note(reason, self)
        self._end(answer)

    def _end(self, answer: bytes) -> None:
        """Ends the connection; an answer that has begun cannot be replaced by another one."""
        if self.transport.is_closing():
            return
        if answer and (self.cycle is None or self.cycle.response_complete or not self.cycle.response_started):
            self.transport.write(answer)
            self.transport.close()
        else:
            self.transport.abort()


def protocol(connections: Connections) -> type[LimitedProtocol]:
    """The protocol whose connections are counted here, as uvicorn makes it."""

    class Protocol(LimitedProtocol):
        def __init__(self, **given: Any) -> None:
            super().__init__(connections, **given)

    return Protocol


class Loop(uvloop.Loop):
    """uvloop with a limited time for the handshake of TLS, in which a connection is not yet counted."""

    async def create_server(self, *given: Any, **options: Any) -> Any:
        """See asyncio."""
        if options.get("ssl") is not None:
            options["ssl_handshake_timeout"] = 10.0
        return await super().create_server(*given, **options)
