"""PendingConnection: HTTP in JSON or msgpack, where a request is sent now and its answer is read later."""

from __future__ import annotations

import time
from typing import Any, Final

from dohyo.service.client.worker_session import Connection, UnreachableError, WireError
from dohyo.service.wire.messages import Format

PATIENCE_S: Final = 600.0
LONGEST_PAUSE_S: Final = 30.0


class PendingConnection:
    """One request at a time; one that the service answers with "not now" is sent again."""

    def __init__(self, url: str) -> None:
        """Connects at the first request.

        Raises:
            InvalidInputError: The address is invalid.
        """
        self._connection = Connection(url)
        self._request: tuple[str, str, Any, str, Format] = "", "", None, "", Format.JSON
        self._failure: UnreachableError | None = None

    def send(self, method: str, path: str, token: str, document: Any = None, fmt: Format = Format.JSON) -> None:
        """Sends a request; failures show in `receive`."""
        self._request = method, path, document, token, fmt
        self._send()

    def _send(self) -> None:
        self._failure = None
        try:
            self._connection.send(*self._request)
        except UnreachableError as error:
            self._failure = error

    def receive(self) -> Any:
        """The answer to the last request; None for an empty one.

        Raises:
            WireError: The service refuses.
            UnreachableError: The service cannot be reached, or is busy for too long.
        """
        ends = time.monotonic() + PATIENCE_S
        while True:
            if self._failure is not None:
                raise self._failure
            try:
                return self._connection.receive()
            except WireError as error:
                if error.status not in (429, 503) or error.retry_s is None or time.monotonic() > ends:
                    raise
                time.sleep(min(error.retry_s, LONGEST_PAUSE_S))
            self._send()

    def close(self) -> None:
        """Closes the connection."""
        self._connection.close()
