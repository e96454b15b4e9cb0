"""The wire's two encodings: msgpack with arrays as raw bytes, and JSON with arrays as nested lists.

An array on the msgpack wire is a map `{shape, dtype, data}` of row-major, little-endian bytes; nested lists of numbers
are understood too. Observations are encoded once, where they are read; the server passes their bytes on.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any, TypeVar

import msgspec
import numpy as np

from dohyo.service.wire.bodies import Step
from dohyo.sumo_networks.errors import InvalidInputError

S = TypeVar("S", bound=msgspec.Struct)
DTYPES = ("float32", "float64", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "bool")
MOST_VALUES = 1_000_000
MOST_DIMENSIONS = 8


class Format(StrEnum):
    """A media type of the wire."""

    MSGPACK = "application/msgpack"
    JSON = "application/json"


_msgpack, _json = msgspec.msgpack.Encoder(), msgspec.json.Encoder()

NOTHING = msgspec.Raw(b"\x80")
"""Empty observations: an empty msgpack map."""


def format_of(media_type: str | None, default: Format | None = Format.JSON) -> Format | None:
    """Format requested by a Content-Type or an Accept header; the default for other types."""
    given = (media_type or "").lower()
    if "msgpack" in given:
        return Format.MSGPACK
    return Format.JSON if "json" in given else default


def encode(document: Any, fmt: Format) -> bytes:
    """Encodes a document; `Raw` parts of it are msgpack.

    Raises:
        InvalidInputError: An integer has more than 64 bits, which msgpack cannot hold.
    """
    try:
        packed = _msgpack.encode(document)
    except OverflowError:
        raise InvalidInputError("expected integers of at most 64 bits, got a larger one") from None
    return packed if fmt is Format.MSGPACK else _json.encode(plain(msgspec.msgpack.decode(packed)))


def decode(body: bytes, fmt: Format) -> Any:
    """Decodes a document.

    Raises:
        InvalidInputError: The body is not of that format.
    """
    try:
        return msgspec.msgpack.decode(body) if fmt is Format.MSGPACK else msgspec.json.decode(body)
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise InvalidInputError(f"expected a body of {fmt}, got {len(body)} bytes: {error}") from None


def decode_as(body: bytes, fmt: Format, struct: type[S], expected: str) -> S:
    """Decodes a document of a struct, of which `Raw` parts stay encoded.

    Raises:
        InvalidInputError: The body is no such document, in words `expected`.
    """
    try:
        if fmt is Format.MSGPACK:
            return msgspec.msgpack.decode(body, type=struct)
        return msgspec.json.decode(body, type=struct)
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise InvalidInputError(f"expected {expected} in {fmt}, got {len(body)} bytes: {error}") from None


def decode_step(body: bytes, fmt: Format) -> Step:
    """Decodes a step except its actions.

    Raises:
        InvalidInputError: The body is not a step.
    """
    return decode_as(body, fmt, Step, "{tick, actions}")


def encode_observations(observations: Mapping[str, Mapping[str, np.ndarray]]) -> bytes:
    """Observations by ego and sensor as msgpack."""
    return _msgpack.encode(
        {ego: {sensor: pack(array) for sensor, array in seen.items()} for ego, seen in observations.items()}
    )


def pack(array: np.ndarray) -> dict[str, Any]:
    """An array in the form of the msgpack wire."""
    if array.dtype.byteorder == ">" or (array.dtype.byteorder == "=" and sys.byteorder == "big"):
        array = array.astype(array.dtype.newbyteorder("<"))
    return {"shape": array.shape, "dtype": array.dtype.name, "data": array.tobytes()}


def unpack(value: Any) -> np.ndarray:
    """An array from the wire: a packed one, or a (nested) list of numbers.

    Raises:
        InvalidInputError: The value is neither.
    """
    if isinstance(value, Mapping):
        return _unpacked(value)
    try:
        array = np.asarray(value)
    except ValueError:
        raise InvalidInputError("expected an array, got lists of unequal lengths") from None
    if array.dtype.kind not in "biuf":
        raise InvalidInputError(f"expected numbers of at most 64 bits, got {_in_words(value)}")
    return array


def _in_words(value: Any) -> str:
    """A value from the wire that is no array of numbers, for a message in words of JSON."""
    while isinstance(value, list | tuple) and value:
        value = next((one for one in value if not isinstance(one, int | float)), value[0])
    names = {str: "a string", bytes: "bytes", type(None): "null", list: "an empty list", int: "a larger integer"}
    return names.get(type(value), f"a {type(value).__name__}")


def shape_in_words(shape: Sequence[int]) -> str:
    """A shape for a message, such as "a list of 8 lists of 2 numbers"."""
    if not shape:
        return "a number"
    inner = "numbers" if len(shape) == 1 else shape_in_words(shape[1:]).removeprefix("a ").replace("list", "lists", 1)
    return f"a list of {shape[0]} {inner}"


def _unpacked(value: Mapping[str, Any]) -> np.ndarray:
    shape: Any = value.get("shape")
    dtype: Any = value.get("dtype")
    data: Any = value.get("data")
    well_formed = isinstance(shape, list | tuple) and isinstance(data, bytes) and dtype in DTYPES
    if well_formed and len(shape) > MOST_DIMENSIONS:
        raise InvalidInputError(f"expected an array of at most {MOST_DIMENSIONS} dimensions, got {len(shape)}")
    if not well_formed or not all(type(n) is int and 0 <= n <= MOST_VALUES for n in shape or ()):
        raise InvalidInputError(f"expected an array {{shape, dtype, data}}, dtype one of {', '.join(DTYPES)}")
    kind = np.dtype(dtype).newbyteorder("<")
    size = math.prod(shape)
    if size * kind.itemsize != len(data):
        raise InvalidInputError(f"expected {size} values of {dtype} for shape {list(shape)}, got {len(data)} bytes")
    try:
        return np.frombuffer(data, kind).reshape(shape)
    except ValueError:  # an empty array too has a largest shape
        raise InvalidInputError(f"expected an array of a possible shape, got {list(shape)}") from None


def plain(value: Any) -> Any:
    """A document with nested lists in place of packed arrays."""
    if isinstance(value, dict):
        if value.keys() == {"shape", "dtype", "data"}:
            return unpack(value).tolist()
        return {key: plain(one) for key, one in value.items()}
    return [plain(one) for one in value] if isinstance(value, list | tuple) else value


def arrays(observations: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, np.ndarray]]:
    """Observations from the wire as arrays by ego and sensor, as sensors give them: float32, packed pictures uint8."""
    return {ego: {sensor: _seen(unpack(value)) for sensor, value in seen.items()} for ego, seen in observations.items()}


def _seen(array: np.ndarray) -> np.ndarray:
    """A copy, to which an agent may write, of a type that sensors have."""
    return np.array(array, dtype=np.uint8 if array.dtype == np.uint8 else np.float32)
