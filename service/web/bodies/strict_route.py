"""Routes with a JSON body: who calls is known before the body is read.

The event loop parses short bodies only; others are parsed in threads, and paid by the caller.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any, Final

from fastapi import Request
from fastapi.dependencies.models import Dependant
from fastapi.dependencies.utils import solve_dependencies
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from fastapi.routing import APIRoute
from fastapi.security.base import SecurityBase

from dohyo.service.errors import TooLargeError
from dohyo.service.web.addresses import payer_of
from dohyo.service.web.bodies.strict_json import JsonError, parse_json

ANONYMOUS_BYTES: Final = 16_000
"""Longest body of a caller without a token."""
SHORT_BYTES: Final = 2_000
"""Longest body that the event loop parses itself, in about a millisecond."""


class StrictRoute(APIRoute):
    """A route that identifies its caller, and then reads and checks a JSON body."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Handler with the checks before it."""
        handle = super().get_route_handler()
        if self.body_field is None:
            return handle
        access = Dependant(dependencies=[one for one in self.dependant.dependencies if _reads_credentials(one)])

        async def check_and_handle(request: Request) -> Response:
            stack = request.scope["fastapi_inner_astack"]
            await solve_dependencies(request=request, dependant=access, async_exit_stack=stack, embed_body_fields=False)
            caller = getattr(request.state, "caller", None)
            body = await _read(request, ANONYMOUS_BYTES if caller is None else None)
            return await handle(_CheckedRequest(request, body, await _parsed(request, body)))

        return check_and_handle


class _CheckedRequest(Request):
    """A request whose body has been read, parsed and checked."""

    def __init__(self, request: Request, body: bytes, document: Any) -> None:
        super().__init__(request.scope, request.receive)
        self._bytes, self._document = body, document

    async def body(self) -> bytes:
        """The body."""
        return self._bytes

    async def json(self) -> Any:
        """The document."""
        return self._document


def _reads_credentials(dependant: Dependant) -> bool:
    return isinstance(dependant.call, SecurityBase) or any(map(_reads_credentials, dependant.dependencies))


async def _read(request: Request, limit: int | None) -> bytes:
    """The body, whose length has a limit besides that of all requests."""
    body = bytearray()
    async for piece in request.stream():
        body += piece
        if limit is not None and len(body) > limit:
            raise TooLargeError(limit)
    return bytes(body)


async def _parsed(request: Request, body: bytes) -> Any:
    if not body:
        return None
    try:
        if len(body) <= SHORT_BYTES:
            return parse_json(body)
        anonymous = getattr(request.state, "caller", None) is None
        bodies = request.app.state.services.bodies
        return await bodies.compute(partial(parse_json, body), payer_of(request), anonymous)
    except JsonError as error:
        fault = {"loc": ("body", *error.place), "msg": error.expected, "type": "json_invalid"}
        raise RequestValidationError([fault]) from error
