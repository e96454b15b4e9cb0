"""Strict JSON: what Python's parser takes, but a database, another language or a later answer cannot hold, is refused.

Refused are: keys given twice, numbers that are not finite, integers beyond 64 bits, halves of surrogate pairs, control
characters, nesting that is too deep, and too many values. The error names the place.

Values are counted before anything is parsed, and a request's body is read only once its caller is known. The event loop
parses short bodies only; others are parsed in threads, and paid by the caller.
"""

from __future__ import annotations

import json
import math
import re
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
from dohyo.sumo_networks.errors import InvalidInputError

DEEPEST: Final = 32
MOST_VALUES: Final = 20_000
MOST_KEYS: Final = 1_000
LONGEST_KEY: Final = 200
LARGEST_INTEGER: Final = 2**63 - 1
LONGEST_NUMBER: Final = 400
"""Digits of a number; 64 bits need 20, and Python's parser takes quadratic time for long integers."""
ANONYMOUS_BYTES: Final = 16_000
"""Longest body of a caller without a token."""
SHORT_BYTES: Final = 2_000
"""Longest body that the event loop parses itself, in about a millisecond."""

_FORBIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")
"""Control characters except tab and line ends, and halves of surrogate pairs."""

Place = tuple[str | int, ...]


class JsonError(InvalidInputError):
    """A JSON document that is refused.

    Attributes:
        place: Keys and indices that lead to the fault.
        expected: What was expected there.
    """

    def __init__(self, place: Place, expected: str) -> None:
        super().__init__(f"{'.'.join(str(part)[:LONGEST_KEY] for part in place) or 'the document'}: {expected}")
        self.place, self.expected = place, expected


class _Pairs(list[tuple[str, Any]]):
    """An object as it was written, with keys that may repeat."""


class _Unusable:
    """A number that is refused, with the reason."""

    def __init__(self, expected: str) -> None:
        self.expected = expected


def parse_json(text: str | bytes) -> Any:
    """Parses a strict JSON document.

    Raises:
        JsonError: It is no JSON, or refused.
    """
    try:
        text = text if isinstance(text, str) else text.decode("utf-8-sig")
        _check_count(text)
        written = json.loads(
            text, object_pairs_hook=_Pairs, parse_int=_integer, parse_float=_number, parse_constant=_constant
        )
    except RecursionError as error:
        raise JsonError((), f"expected at most {DEEPEST} levels of nesting") from error
    except UnicodeDecodeError as error:
        raise JsonError((), "expected text in UTF-8") from error
    except ValueError as error:
        raise JsonError((), f"expected JSON: {error}") from error
    return _checked(written, [])


def require_text(text: str, *place: str | int) -> str:
    """A text without control characters and halves of surrogate pairs.

    Raises:
        JsonError: It has some.
    """
    found = _FORBIDDEN.search(text)
    if found is not None:
        raise JsonError(place, f"expected text without the character U+{ord(found[0]):04X}")
    return text


def readable(text: str) -> str:
    """A text with a replacement character for each that `require_text` refuses."""
    return _FORBIDDEN.sub("\ufffd", text)


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


def _check_count(text: str) -> None:
    """Refuses too many values by what stands between them, since the parser would make all of them first."""
    unescaped = text.replace("\\\\", "").replace('\\"', "")
    if unescaped.count('"') <= 4 * MOST_VALUES:  # two of each text, and of its key
        between = "".join(unescaped.split('"')[::2])
        if between.count(",") + between.count("[") + between.count("{") < MOST_VALUES:
            return
    raise JsonError((), f"expected at most {MOST_VALUES} values in all")


def _checked(value: Any, place: list[str | int]) -> Any:
    """The plain value of what was written at a place."""
    if len(place) > DEEPEST:
        raise JsonError(tuple(place), f"expected at most {DEEPEST} levels of nesting")
    if isinstance(value, _Unusable):
        raise JsonError(tuple(place), value.expected)
    if isinstance(value, str):
        return require_text(value, *place)
    if isinstance(value, _Pairs):
        return _object(value, place)
    return _list(value, place) if isinstance(value, list) else value


def _list(values: list[Any], place: list[str | int]) -> list[Any]:
    found = []
    for index, value in enumerate(values):
        place.append(index)
        found.append(_checked(value, place))
        place.pop()
    return found


def _object(pairs: _Pairs, place: list[str | int]) -> dict[str, Any]:
    if len(pairs) > MOST_KEYS:
        raise JsonError(tuple(place), f"expected at most {MOST_KEYS} keys, got {len(pairs)}")
    found: dict[str, Any] = {}
    for key, value in pairs:
        if len(key) > LONGEST_KEY:
            raise JsonError(tuple(place), f"expected keys of at most {LONGEST_KEY} characters, got {len(key)}")
        require_text(key, *place)
        if key in found:
            raise JsonError((*place, key), "expected each key once")
        place.append(key)
        found[key] = _checked(value, place)
        place.pop()
    return found


def _integer(digits: str) -> int | _Unusable:
    if len(digits) > LONGEST_NUMBER or abs(int(digits)) > LARGEST_INTEGER:
        return _Unusable("expected an integer of 64 bits")
    return int(digits)


def _number(digits: str) -> float | _Unusable:
    if len(digits) > LONGEST_NUMBER or not math.isfinite(float(digits)):
        return _Unusable("expected a finite number")
    return float(digits)


def _constant(name: str) -> _Unusable:
    return _Unusable(f"expected a finite number, got {name}")
