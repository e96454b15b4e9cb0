"""Limits on every request, as pure ASGI middleware, since each layer adds to the latency of every step."""

from __future__ import annotations

import asyncio
import hashlib
import logging
import math
import secrets
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from fastapi.security.utils import get_authorization_scheme_param
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from dohyo.service.errors import BusyError, TooLargeError, problem
from dohyo.service.monitoring.metrics import Metrics
from dohyo.service.web.addresses import client_of
from dohyo.service.web.bodies.strict_route import ANONYMOUS_BYTES

WIRE = ("/v1/workers", "/v1/leases", "/v1/seats")
FREE = ("/health", "/static")
UPLOADS = ("/v1/networks", "/submissions/onnx")
FORMS = ("/login", "/logout", "/join")
REDEMPTIONS = ("/v1/invitations/redeem", "/join")
REDEMPTIONS_PER_DAY = 200  # of one address, behind which a whole class may sit
DAY_S = 86_400.0
FORM_BYTES = 100_000  # size of an upload's other fields
SECURITY = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
        "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    ),
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=()",
    "referrer-policy": "same-origin",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
}

access_log = logging.getLogger("dohyo.access")


def _on_wire(path: str) -> bool:
    return path.startswith(WIRE)


class BodyLimit:
    """Refuses bodies that are too large with 413, by their declared and their received length; keeps none in memory."""

    def __init__(self, app: ASGIApp, limit: int, upload_limit: int) -> None:
        self.app, self.limit, self.upload_limit = app, limit, upload_limit + FORM_BYTES

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Passes on requests with a body within the limit."""
        if scope["type"] != "http" or scope["method"] in ("GET", "HEAD"):
            await self.app(scope, receive, send)
            return
        limit = self._limit_of(scope["path"].rstrip("/"))
        told = Headers(scope=scope).get("content-length", "")
        if told.isdigit() and int(told) > limit:
            await _too_large(limit)(scope, receive, send)
            return
        answered, got = False, 0

        async def count() -> Message:
            nonlocal got
            message = await receive()
            got += len(message.get("body", b""))
            if got > limit:
                raise HTTPException(413, f"the body is larger than {limit} bytes", {"connection": "close"})
            return message

        async def watch(message: Message) -> None:
            nonlocal answered
            answered = answered or message["type"] == "http.response.start"
            await send(message)

        try:
            await self.app(scope, count, watch)
        except HTTPException as error:
            # The body was read outside the routes' own error handling.
            if error.status_code != 413 or answered:
                raise
            await _too_large(limit)(scope, receive, send)

    def _limit_of(self, path: str) -> int:
        if path.endswith(UPLOADS):
            return self.upload_limit
        return min(self.limit, ANONYMOUS_BYTES) if path in FORMS else self.limit


def _too_large(limit: int) -> Response:
    error = TooLargeError(limit)
    return problem(413, str(error), error.headers)


def _too_many(detail: str, wait_s: float) -> Response:
    seconds = math.ceil(wait_s)
    return problem(429, f"{detail}; wait {seconds} s", {"retry-after": str(seconds)})


def _ending() -> Response:
    error = BusyError("the service is shutting down", retry_s=30)
    return problem(503, str(error), error.headers)


@dataclass(slots=True)
class _Bucket:
    """Token bucket: remaining requests, refilled steadily."""

    left: float
    at: float


class RateLimit:
    """Limits the requests per minute of each token; callers without a valid token share the limit of their address.

    An address also has a limit of redeemed invitations a day, each of which may make an owner.

    A token has its own limit only after it was accepted: attempts to guess tokens count for the address. Steps of
    policy workers and health checks are not counted; wrong tokens on the wire are.
    """

    def __init__(
        self, app: ASGIApp, per_minute: int, clock: Callable[[], float] = time.monotonic, remembered: int = 10_000
    ) -> None:
        self.app, self.per_minute, self.clock, self.remembered = app, per_minute, clock, remembered
        self._buckets: OrderedDict[str, _Bucket] = OrderedDict()
        self._accepted: OrderedDict[str, None] = OrderedDict()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Passes on requests within the rate."""
        if scope["type"] != "http" or scope["path"].startswith(FREE):
            await self.app(scope, receive, send)
            return
        secret = get_authorization_scheme_param(Headers(scope=scope).get("authorization"))[1]
        token = hashlib.sha256(secret.encode("latin-1")).hexdigest() if secret else ""
        address = f"address {client_of((scope.get('client') or ('unknown',))[0])}"
        if _on_wire(scope["path"]):
            await self._pass_on_wire(scope, receive, send, token, address)
            return
        if wait_s := self._take(token if token in self._accepted else address):
            await self._refusal(wait_s)(scope, receive, send)
            return
        redeems = scope["method"] == "POST" and scope["path"] in REDEMPTIONS
        if redeems and (wait_s := self._take(f"redeem {address}", most=REDEMPTIONS_PER_DAY, period_s=DAY_S)):
            await _too_many(f"more than {REDEMPTIONS_PER_DAY} redemptions a day", wait_s)(scope, receive, send)
            return
        state = scope.setdefault("state", {})
        await self.app(scope, receive, send)
        if token and "caller" in state:
            self._remember(token)

    async def _pass_on_wire(self, scope: Scope, receive: Receive, send: Send, token: str, address: str) -> None:
        """Counts only requests with a refused token; tokens accepted before always pass."""
        if token in self._accepted:
            await self.app(scope, receive, send)
            return
        guesses = f"wire {address}"
        if wait_s := self._take(guesses, count=0.0):
            await self._refusal(wait_s)(scope, receive, send)
            return

        async def judge(message: Message) -> None:
            if message["type"] == "http.response.start":
                if message["status"] in (401, 404):
                    self._take(guesses)
                elif token and message["status"] < 300:
                    self._remember(token)
            await send(message)

        await self.app(scope, receive, judge)

    def _refusal(self, wait_s: float) -> Response:
        return _too_many(f"more than {self.per_minute} requests a minute", wait_s)

    def _take(self, key: str, count: float = 1.0, most: int | None = None, period_s: float = 60.0) -> float:
        """Takes requests from a key's bucket; returns the seconds to wait if it is empty."""
        now, full = self.clock(), float(most or self.per_minute)
        bucket = self._buckets.pop(key, None) or _Bucket(full, now)
        rate = full / period_s
        bucket.left = min(full, bucket.left + (now - bucket.at) * rate)
        bucket.at = now
        self._buckets[key] = bucket
        while len(self._buckets) > self.remembered:
            self._buckets.popitem(last=False)
        if bucket.left < 1.0:
            return (1.0 - bucket.left) / rate
        bucket.left -= count
        return 0.0

    def _remember(self, token: str) -> None:
        self._accepted[token] = None
        self._accepted.move_to_end(token)
        while len(self._accepted) > self.remembered:
            self._accepted.popitem(last=False)


class SecurityHeaders:
    """Security headers: browsers run only the service's own scripts and show its pages in no frame."""

    def __init__(self, app: ASGIApp, tls: bool) -> None:
        self.app = app
        headers = {**SECURITY, **({"strict-transport-security": "max-age=31536000"} if tls else {})}
        self.headers: Iterable[tuple[bytes, bytes]] = tuple((k.encode(), v.encode()) for k, v in headers.items())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Adds the headers, except on the wire, which is for programs."""
        if scope["type"] != "http" or _on_wire(scope["path"]):
            await self.app(scope, receive, send)
            return

        async def add(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *self.headers]
            await send(message)

        await self.app(scope, receive, add)


class AccessLog:
    """Gives each request an identifier, counts it, and logs caller, path and duration; never a token, body or query."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self.app, self.metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Identifies, measures and logs a request."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        name = secrets.token_hex(8)
        state = scope.setdefault("state", {})
        state["request_id"] = name
        started, status, answered = time.perf_counter(), 500, False

        async def note(message: Message) -> None:
            nonlocal status, answered
            if message["type"] == "http.response.start":
                status, answered = message["status"], True
                MutableHeaders(scope=message)["x-request-id"] = name
            await send(message)

        try:
            await self.app(scope, receive, note)
        except asyncio.CancelledError:
            # Only the shutdown of the service cancels a request.
            if answered:
                raise
            await _ending()(scope, receive, note)
        finally:
            took_s = time.perf_counter() - started
            self.metrics.note_request(scope, status, took_s)
            level = logging.DEBUG if _on_wire(scope["path"]) and status < 400 else logging.INFO
            if access_log.isEnabledFor(level):
                caller = state.get("caller")
                facts = {
                    "request": name,
                    "method": scope["method"],
                    "path": scope["path"],
                    "status": status,
                    "ms": round(took_s * 1000, 1),
                    "address": (scope.get("client") or (None,))[0],
                    "owner": caller.owner if caller is not None else None,
                }
                access_log.log(level, "request", extra={"facts": facts})
