"""Strict JSON: what Python's parser takes, but a database, another language or a later answer cannot hold, is refused.

Refused are: keys given twice, numbers that are not finite, integers beyond 64 bits, halves of surrogate pairs, control
characters, nesting that is too deep, and too many values. The error names the place.

Values are counted before anything is parsed.
"""

from __future__ import annotations

import json
import math
import re
from typing import Any, Final

from dohyo.sumo_networks.errors import InvalidInputError

DEEPEST: Final = 32
MOST_VALUES: Final = 20_000
MOST_KEYS: Final = 1_000
LONGEST_KEY: Final = 200
LARGEST_INTEGER: Final = 2**63 - 1
LONGEST_NUMBER: Final = 400
"""Digits of a number; 64 bits need 20, and Python's parser takes quadratic time for long integers."""

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
