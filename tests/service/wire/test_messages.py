"""The wire's encodings: what goes in comes out, and nothing else gets in."""

from __future__ import annotations

import json
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of

from dohyo.service.wire.bodies import Reply
from dohyo.service.wire.messages import (
    DTYPES,
    NOTHING,
    Format,
    arrays,
    decode,
    decode_step,
    encode,
    encode_observations,
    format_of,
    pack,
    unpack,
)
from dohyo.sumo_networks.errors import InvalidInputError

any_array = st.sampled_from(DTYPES).flatmap(
    lambda dtype: arrays_of.arrays(
        dtype,
        arrays_of.array_shapes(min_dims=0, max_side=5),
        elements={"allow_nan": False} if "f" in dtype[:1] else None,
    )
)


@given(any_array, st.sampled_from(["<", ">"]))
def test_an_array_comes_back_as_it_was(array: np.ndarray, order: Any) -> None:
    there = msgspec.msgpack.decode(msgspec.msgpack.encode(pack(array.astype(array.dtype.newbyteorder(order)))))
    back = unpack(there)
    assert back.dtype.name == array.dtype.name
    assert back.shape == array.shape
    assert np.array_equal(back, array)


@given(
    st.dictionaries(st.text(max_size=5), arrays_of.arrays(np.float32, (3, 2), elements=st.floats(-10, 10, width=32)))
)
def test_both_formats_say_the_same(seen: dict[str, np.ndarray]) -> None:
    raw = msgspec.Raw(encode_observations({"ego": seen}))
    reply = Reply(3, 0.3, raw, done=False, missed=0, clipped=0, directive="run")
    packed = decode(encode(reply, Format.MSGPACK), Format.MSGPACK)
    text = json.loads(encode(reply, Format.JSON))
    assert {key: value for key, value in packed.items() if key != "observations"} == {
        key: value for key, value in text.items() if key != "observations"
    }
    for given_one in (packed, text):
        back = arrays(given_one["observations"])["ego"]
        assert back.keys() == seen.keys()
        assert all(np.array_equal(back[key], seen[key]) and back[key].dtype == np.float32 for key in seen)


@given(st.binary(max_size=60), st.sampled_from(list(Format)))
def test_garbage_is_refused_in_one_line(body: bytes, fmt: Format) -> None:
    try:
        step = decode_step(body, fmt)
    except InvalidInputError:
        return
    assert isinstance(step.tick, int)


@pytest.mark.parametrize(
    "value",
    [
        None,
        "fast",
        {"shape": [2], "dtype": "float32", "data": b"1234"},
        {"shape": [-1], "dtype": "float32", "data": b""},
        {"shape": [2**40, 2**40], "dtype": "float32", "data": b""},
        {"shape": [1], "dtype": "object", "data": b"12345678"},
        {"shape": [1] * 70, "dtype": "float32", "data": b"1234"},
        {"shape": [0] * 70, "dtype": "float32", "data": b""},
        {"shape": [0, *[10**6] * 7], "dtype": "float32", "data": b""},
        {"shape": "2", "dtype": "float32", "data": b"12345678"},
        {"shape": [True, True], "dtype": "int8", "data": b"1"},
        {},
        [[1, 2], [3]],
        ["1", "2"],
        [None],
    ],
)
def test_what_is_no_array_is_refused(value: Any) -> None:
    with pytest.raises(InvalidInputError, match="expected"):
        unpack(value)


def test_deep_nesting_is_refused_and_not_run_out_of_stack_on() -> None:
    with pytest.raises(InvalidInputError):
        decode(b"[" * 100_000, Format.JSON)
    with pytest.raises(InvalidInputError):
        decode(b"\x91" * 100_000, Format.MSGPACK)


def test_the_format_is_what_the_header_names() -> None:
    assert format_of("application/msgpack") is Format.MSGPACK
    assert format_of("application/x-msgpack; charset=binary") is Format.MSGPACK
    assert format_of("application/json") is Format.JSON
    assert format_of(None) is Format.JSON
    assert format_of("*/*", None) is None
    assert msgspec.msgpack.decode(NOTHING) == {}
