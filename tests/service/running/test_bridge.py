"""The lockstep with a worker, in the episode's process: what the worker sends is driven, or refused with a reason."""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from dohyo.service.running.channel import Channel, Kind
from dohyo.service.running.remote import Bridge

GOOD = msgspec.msgpack.encode({"ego": [1.0, 0.0]})
EMPTY_BUT_HUGE = msgspec.msgpack.encode({"ego": {"shape": [0, *[10**6] * 7], "dtype": "float32", "data": b""}})


def frame(kind: Kind, payload: bytes = b"") -> bytes:
    return struct.pack("!IB", len(payload), kind) + payload


def decided(bad: bytes, check: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, str]:
    """The decision after a bad answer and a good one, and the refusal of the bad one."""
    server, process = socket.socketpair()
    with server, process:
        server.settimeout(10.0)
        bridge = Bridge(Channel(process), {"ego": "ego"}, (2,), check, "wait")
        server.sendall(frame(Kind.GRANT))
        bridge.show(0, {"ego": {}})
        server.sendall(frame(Kind.ACTIONS, b"\0" + bad) + frame(Kind.ACTIONS, b"\0" + GOOD))
        action = bridge.decision("ego")
        told = Channel(server)
        frames = [told.receive(), told.receive()]
    ((_, _), (kind, text)) = [one for one in frames if one is not None]
    assert kind is Kind.REFUSED
    return action, text.decode()


@pytest.mark.parametrize(
    "bad",
    [EMPTY_BUT_HUGE, b"", b"\xc1", b"\x91" * 60_000, b"\xdd\xff\xff\xff\xff"],
    ids=["empty-but-huge", "empty", "unused", "deep", "longer-than-told"],
)
def test_bytes_that_are_no_actions_are_refused(bad: bytes) -> None:
    action, why = decided(bad, lambda given: given)
    assert why.startswith(("expected", "action of 'ego': expected"))
    np.testing.assert_allclose(action, [1.0, 0.0])


@pytest.mark.parametrize("error", [ValueError("array is too big"), MemoryError(), RecursionError("too deep \ud800")])
def test_no_error_over_an_action_is_a_fault_of_the_simulation(error: Exception) -> None:
    """The drive would be lost to the infrastructure, and driven again at no cost."""
    errors = [error]

    def check(given: np.ndarray) -> np.ndarray:
        if errors:
            raise errors.pop()
        return given

    action, why = decided(GOOD, check)
    assert why.startswith(f"expected actions, got what cannot be read: {type(error).__name__}")
    np.testing.assert_allclose(action, [1.0, 0.0])
