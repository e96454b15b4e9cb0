"""Requests of the wire: token, formats and body, read by hand, and the answers to them."""

from __future__ import annotations

import asyncio

import msgspec
from fastapi import Response
from starlette.types import Receive, Scope

from dohyo.service.errors import ConflictError, ServiceError, TooLargeError, problem
from dohyo.service.wire.messages import Format, encode, format_of
from dohyo.sumo_networks.errors import InvalidInputError

BODY_LIMIT = 64 * 1024
LARGE_BYTES = 16 * 1024


class StaleTickError(ConflictError):
    """A decision for a tick other than the current one."""

    def __init__(self, expected: int, got: int) -> None:
        super().__init__(f"stale tick: expected actions for tick {expected}, got {got}")
        self.expected = expected


class StaleRunError(ConflictError):
    """A decision for a run of a world before its last reset."""

    def __init__(self, expected_resets: int, tick: int, got: int) -> None:
        super().__init__(f"stale run: expected actions for tick {tick} with resets {expected_resets}, got resets {got}")
        self.expected_resets, self.tick = expected_resets, tick


def headers_of(scope: Scope) -> dict[bytes, bytes]:
    """Headers of a request."""
    return dict(scope["headers"])


def bearer_of(headers: dict[bytes, bytes]) -> str:
    """The bearer token of a request; "" without one."""
    scheme, _, token = headers.get(b"authorization", b"").decode("latin-1").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else ""


def formats_of(headers: dict[bytes, bytes]) -> tuple[Format, Format]:
    """Formats of the body and of the answer; the answer has the body's unless another is requested."""
    taken = format_of(headers.get(b"content-type", b"").decode("latin-1"))
    answered = format_of(headers.get(b"accept", b"").decode("latin-1"), None)
    if b"content-type" not in headers and answered is not None:
        taken = answered
    assert taken is not None
    return taken, answered or taken


async def body_of(headers: dict[bytes, bytes], receive: Receive, limit: int = BODY_LIMIT) -> bytes:
    """The whole body; a body of more than `limit` bytes is refused before it is read.

    Raises:
        TooLargeError: The body is too large.
    """
    told = headers.get(b"content-length", b"0")
    if told.isdigit() and int(told) > limit:
        raise TooLargeError(limit)
    body = b""
    while True:
        message = await receive()
        body += message.get("body", b"")
        if len(body) > limit:
            raise TooLargeError(limit)
        if not message.get("more_body", False):
            return bytes(body)


async def encoded(answer: msgspec.Struct, fmt: Format, observations: msgspec.Raw) -> bytes:
    """An answer in a format; large observations become JSON in a thread, as all other workers would wait for it."""
    if fmt is Format.JSON and memoryview(observations).nbytes > LARGE_BYTES:
        return await asyncio.to_thread(encode, answer, fmt)
    return encode(answer, fmt)


def problem_of(error: ServiceError | InvalidInputError) -> Response:
    """An error of the wire as a problem document, always in JSON."""
    if isinstance(error, StaleTickError):
        return problem(error.status, str(error), expected_tick=error.expected)
    if isinstance(error, StaleRunError):
        return problem(error.status, str(error), expected_resets=error.expected_resets, tick=error.tick)
    if isinstance(error, ServiceError):
        return problem(error.status, str(error), error.headers)
    return problem(422, str(error))
