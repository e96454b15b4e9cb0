"""Connection: one kept connection to a service, in msgpack, and what may go wrong with it."""

from __future__ import annotations

import ssl
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.client import HTTPConnection, HTTPException, HTTPResponse, HTTPSConnection
from typing import Any
from urllib.parse import urlsplit

import msgspec

from dohyo.service.wire.foreign import Answer, media_type, redirection, told
from dohyo.service.wire.messages import Format, decode, encode
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError

REPLY_S = 150.0  # a tick of a large network may be slow
IDLE_S = 30.0  # well below the time after which the service closes a connection that nobody uses
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.2, 5.0
NO_CONTENT = 204
PASSING = (429, 500, 502, 503, 504)
"""Refusals that end by themselves; a proxy answers with 502 or 504 while the service behind it restarts."""


class WireError(DohyoError):
    """A refusal of the service.

    Attributes:
        status: HTTP status.
        retry_s: Seconds to wait before a retry, where the service gave them.
    """

    def __init__(self, status: int, detail: str, retry_s: float | None = None) -> None:
        super().__init__(f"{detail} (HTTP {status})")
        self.status, self.detail, self.retry_s = status, detail, retry_s


class LeaseLostError(WireError):
    """410: the lease is lost."""


class BadActionError(WireError):
    """422: the action is invalid; another one may be sent before the deadline."""


class UnknownWorkerError(WireError):
    """401: the service does not know this worker, for example after a restart: register again."""


class UnreachableError(DohyoError):
    """No service answers at the address."""


class ForeignAnswerError(UnreachableError):
    """Something else than a dohyo service answers at the address, such as a proxy while the service restarts."""


def passes(error: UnreachableError | WireError) -> bool:
    """Whether the same request may be answered later."""
    return isinstance(error, UnreachableError) or error.status in PASSING


_ERRORS = {401: UnknownWorkerError, 410: LeaseLostError, 422: BadActionError}


class Connection:
    """A persistent HTTP connection with msgpack bodies; reopened after a failure."""

    def __init__(self, url: str, timeout_s: float = REPLY_S) -> None:
        """Connects at the first request.

        Args:
            url: Address of the service, http or https.
            timeout_s: Time limit of an answer.

        Raises:
            InvalidInputError: The address is invalid.
        """
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise InvalidInputError(f"expected the service's address, such as http://127.0.0.1:8000, got '{url}'")
        self._url = url
        self._secure, self._host, self._port = parts.scheme == "https", parts.hostname, parts.port
        self._prefix, self._timeout_s = parts.path.rstrip("/"), timeout_s
        self._connection: HTTPConnection | None = None
        self._used = 0.0  # monotonic time

    def post(self, path: str, document: Any, token: str) -> Any:
        """Sends a document and returns the answer; None for an empty one.

        Raises:
            WireError: The service refuses.
            UnreachableError: The connection failed, before or after the service had read the request.
        """
        self.send("POST", path, document, token)
        return self.receive()

    def send(
        self, method: str, path: str, document: Any, token: str, fmt: Format = Format.MSGPACK, key: str | None = None
    ) -> None:
        """Sends a request, whose answer `receive` must read; without a document it has no body.

        Args:
            method: Such as "POST".
            path: Under the service's address.
            document: What is sent, in a format.
            token: Bearer token.
            fmt: Format of the document; the answer may be in either.
            key: Header `Idempotency-Key`; None: without.

        Raises:
            UnreachableError: The connection failed.
        """
        headers = {"authorization": f"Bearer {token}", "accept": Format.MSGPACK.value}
        headers |= {"idempotency-key": key} if key is not None else {}
        body = None
        if document is not None:
            headers["content-type"], body = fmt.value, encode(document, fmt)
        if time.monotonic() - self._used > IDLE_S:
            self.close()  # the service may have closed its end, which shows only after a request has gone
        self._used = time.monotonic()
        with self._one_answer():
            if self._connection is None:
                self._connection = self._open()
            self._connection.request(method, self._prefix + path, body, headers)

    def receive(self) -> Any:
        """The answer to the request that was sent; None for an empty one.

        Raises:
            WireError: The service refuses, or another address is told.
            ForeignAnswerError: Something else than a service answers.
            UnreachableError: The connection failed, before or after the service had read the request.
        """
        assert self._connection is not None
        with self._one_answer():
            response = self._connection.getresponse()
            body = response.read()
        self._used = time.monotonic()
        if response.status >= 400:
            raise _refusal(self._url, response, body)
        if response.status >= 300:
            raise WireError(response.status, told(self._url, redirection(response.getheader("location"))))
        return self._document(body, response.getheader("content-type")) if response.status != NO_CONTENT else None

    def _document(self, body: bytes, content_type: str | None) -> Any:
        sent = media_type(content_type) or Format.MSGPACK.value
        try:
            document = decode(body, Format(sent))
        except InvalidInputError:
            raise self._foreign(f"{sent} that cannot be read") from None
        except ValueError:
            raise self._foreign(sent) from None
        return Answer(document, self._foreign) if isinstance(document, dict) else document

    def _foreign(self, sent: str) -> ForeignAnswerError:
        return ForeignAnswerError(told(self._url, sent))

    @contextmanager
    def _one_answer(self) -> Iterator[None]:
        """Closes the connection after a failure: its next answer would belong to another request."""
        try:
            yield
        except (OSError, HTTPException) as error:
            self.close()
            raise UnreachableError(f"no answer from {self._host}: {type(error).__name__}: {error}") from error
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Closes the connection."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _open(self) -> HTTPConnection:
        if not self._secure:
            return HTTPConnection(self._host, self._port, timeout=self._timeout_s)
        context = ssl.create_default_context()
        return HTTPSConnection(self._host, self._port, timeout=self._timeout_s, context=context)


@dataclass(slots=True)
class Pauses:
    """Growing pauses between attempts, or those that the service asks for."""

    _seconds: float = field(default=FIRST_PAUSE_S)

    def next(self, error: Exception | None = None) -> float:
        """Seconds to wait now."""
        told = error.retry_s if isinstance(error, WireError) else None
        pause, self._seconds = self._seconds, min(self._seconds * 2, LONGEST_PAUSE_S)
        return told if told is not None else pause

    def reset(self) -> None:
        """Resets the pause after a success."""
        self._seconds = FIRST_PAUSE_S


def _refusal(url: str, response: HTTPResponse, body: bytes) -> WireError:
    try:
        document = msgspec.json.decode(body)
        detail = str(document["detail"])
    except (msgspec.DecodeError, KeyError, TypeError):
        sent = media_type(response.getheader("content-type"))
        text = body[:200].decode(errors="replace") or "no reason given"
        detail = told(url, sent) if sent == "text/html" else text
    retry_after = response.getheader("retry-after")
    retry_s = float(retry_after) if retry_after is not None and retry_after.isdigit() else None
    return _ERRORS.get(response.status, WireError)(response.status, detail, retry_s)
