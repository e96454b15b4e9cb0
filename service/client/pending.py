"""PendingConnection: HTTP in JSON or msgpack, where a request is sent now and its answer is read later."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, Final

from dohyo.service.client.connection import Connection, Pauses, UnreachableError, WireError, passes
from dohyo.service.wire.messages import Format

BUSY_S: Final = 600.0
"""Patience with a service that says when to come again, such as a world whose tick waits for others."""
AWAY_S: Final = 120.0
"""Patience with one that was there and cannot answer, as a worker has: a restart, also behind a proxy."""
LONGEST_PAUSE_S: Final = 30.0


class PendingConnection:
    """One request at a time; one that the service cannot answer now is sent again, so it must be repeatable."""

    def __init__(self, url: str) -> None:
        """Connects at the first request.

        Raises:
            InvalidInputError: The address is invalid.
        """
        self._connection = Connection(url)
        self._request: tuple[str, str, Any, str, Format, str | None] = "", "", None, "", Format.JSON, None
        self._failure: UnreachableError | None = None
        self._answered = False

    def send(
        self,
        method: str,
        path: str,
        token: str,
        document: Any = None,
        fmt: Format = Format.JSON,
        *,
        key: str | None = None,
    ) -> None:
        """Sends a request; failures show in `receive`.

        Args:
            method: Such as "POST".
            path: Under the service's address.
            token: Bearer token.
            document: What is sent, in a format; None: nothing.
            fmt: Format of the document.
            key: `Idempotency-Key` of a request that would otherwise have an effect each time that it is sent.
        """
        self._request = method, path, document, token, fmt, key
        self._send()

    def _send(self) -> None:
        self._failure = None
        try:
            self._connection.send(*self._request)
        except UnreachableError as error:
            self._failure = error

    def receive(self, patience_s: float = math.inf, busy: Callable[[WireError], None] | None = None) -> Any:
        """The answer to the last request; None for an empty one.

        Args:
            patience_s: Longest time for which the request is sent again; never more than `BUSY_S` or `AWAY_S`.
            busy: Called with each refusal before the request is sent again; may raise an error of its own.

        Raises:
            WireError: The service refuses, or is busy for too long.
            UnreachableError: The service cannot be reached, for too long if it ever answered.
        """
        began, pauses = time.monotonic(), Pauses()
        while True:
            try:
                return self._receive()
            except (UnreachableError, WireError) as error:
                pause_s = min(pauses.next(error), LONGEST_PAUSE_S)
                ends = began + min(self._patience_s(error), patience_s)
                if not passes(error) or time.monotonic() + pause_s > ends:
                    raise
                if busy is not None and isinstance(error, WireError):
                    busy(error)
            time.sleep(pause_s)
            self._send()

    def _receive(self) -> Any:
        if self._failure is not None:
            raise self._failure
        answer = self._connection.receive()
        self._answered = True
        return answer

    def _patience_s(self, error: UnreachableError | WireError) -> float:
        if isinstance(error, WireError) and error.status in (429, 503) and error.retry_s is not None:
            return BUSY_S
        return AWAY_S if self._answered else 0.0  # an address that never answered may be wrong

    def close(self) -> None:
        """Closes the connection."""
        self._connection.close()
