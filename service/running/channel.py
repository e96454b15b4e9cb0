"""Channel of frames between the server and an episode process: a socket pair; a frame has a kind and a payload."""

from __future__ import annotations

import asyncio
import os
import select
import socket
import struct
import time
from collections.abc import Callable
from enum import IntEnum, StrEnum
from typing import NoReturn, cast

from dohyo.service.wire.messages import Format

SEEN = struct.Struct("!IdII")  # tick, simulated time [s], decisions missed, actions clipped
FORMATS = (Format.MSGPACK, Format.JSON)

_HEADER = struct.Struct("!IB")
_CHUNK = 1 << 18


class Kind(IntEnum):
    """Kind of a frame; the first four, DRIVERS and WATCH go to the process, the others come from it."""

    ORDER = 1  # JSON of an EpisodeOrder: drive this
    GRANT = 2  # a worker holds the episode: the clock of its first decision runs
    ACTIONS = 3  # one byte for the format, then actions by ego
    FAULT = 4  # JSON [fault, text]: the worker's agent has failed
    SEEN = 5  # tick, time, missed, then observations in msgpack
    REFUSED = 6  # text: why the last actions are invalid
    FINISHED = 7  # the record is on disk
    IMPOSSIBLE = 8  # text: the order can never be driven
    FAILED = 9  # text: an internal error
    DRIVERS = 10  # JSON: new drivers of a world's egos; to the process
    WATCH = 11  # one byte: whether somebody watches a world; to the process
    STAGE = 12  # JSON: what does not change in a world that is watched
    SCENE = 13  # JSON: what is seen of it in one tick
    RESET = 14  # JSON: a world begins anew; to the process


class Fault(StrEnum):
    """Fault of a worker's agent."""

    RAISED = "raised"
    INVALID_ACTION = "invalid_action"
    TIMEOUT = "timeout"


class Channel:
    """Blocking end in the episode process; it exits the process when the server is gone."""

    def __init__(self, sock: socket.socket) -> None:
        self._socket = sock
        sock.setblocking(True)
        self._poll = select.poll()
        self._poll.register(sock, select.POLLIN)
        self._buffer = bytearray()

    def fileno(self) -> int:
        """File descriptor of the socket."""
        return self._socket.fileno()

    def send(self, kind: Kind, payload: bytes = b"") -> None:
        """Sends one frame."""
        try:
            self._socket.sendall(_HEADER.pack(len(payload), kind) + payload)
        except OSError:
            _end()

    def receive(self, timeout_s: float | None = None) -> tuple[Kind, bytes] | None:
        """The next frame; None after the time-out."""
        ends = None if timeout_s is None else time.monotonic() + timeout_s
        while (frame := _take(self._buffer)) is None:
            if ends is not None and not self._poll.poll(max(0.0, ends - time.monotonic()) * 1000.0):
                return None
            self._buffer += self._read()
        return frame

    def _read(self) -> bytes:
        try:
            chunk = self._socket.recv(_CHUNK)
        except OSError:
            chunk = b""
        return chunk or _end()


def _end() -> NoReturn:
    """Exits the process at once: an exception could be recorded as the agent's fault."""
    os._exit(0)


class Frames(asyncio.Protocol):
    """Asynchronous end in the server."""

    def __init__(self, received: Callable[[Kind, bytes], None], lost: Callable[[], None]) -> None:
        """Calls `received` with each frame and `lost` once the other end is gone."""
        self._received, self._lost = received, lost
        self._buffer = bytearray()
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See `asyncio.Protocol`."""
        self._transport = cast(asyncio.Transport, transport)  # uvloop's transport is not a subclass of asyncio's

    def data_received(self, data: bytes) -> None:
        """See `asyncio.Protocol`."""
        self._buffer += data
        while (frame := _take(self._buffer)) is not None:
            self._received(*frame)

    def connection_lost(self, exc: Exception | None) -> None:
        """See `asyncio.Protocol`."""
        self._transport = None
        self._lost()

    def send(self, kind: Kind, payload: bytes = b"") -> None:
        """Sends one frame, unless the other end is gone."""
        if self._transport is not None:
            self._transport.write(_HEADER.pack(len(payload), kind) + payload)

    def close(self) -> None:
        """Closes this end."""
        if self._transport is not None:
            self._transport.abort()


def _take(buffer: bytearray) -> tuple[Kind, bytes] | None:
    """The first complete frame of a buffer, removed from it; None for an incomplete one."""
    if len(buffer) < _HEADER.size:
        return None
    size, kind = _HEADER.unpack_from(buffer)
    end = _HEADER.size + size
    if len(buffer) < end:
        return None
    payload = bytes(memoryview(buffer)[_HEADER.size : end])
    del buffer[:end]
    return Kind(kind), payload
