"""Frames between a confined process and its parent: four bytes of length, then the content.

The first byte of an answer says what it is; requests are raw.
"""

from __future__ import annotations

import os
import struct

GOOD, BAD, FULL, BROKEN = b"+", b"-", b"!", b"?"
"""The answer; a refusal and its reason; a full disk; a fault of the task's own and its traceback."""
LENGTH = struct.Struct("<I")
LONGEST_REASON = 4000


class Stream:
    """The confined process's end: requests come in, answers go out."""

    def __init__(self, requests: int, answers: int) -> None:
        self._requests, self._answers = requests, answers

    def read(self) -> bytearray:
        """The next frame.

        Raises:
            EOFError: The parent is gone.
        """
        head = bytearray(LENGTH.size)
        self.read_into(head)
        frame = bytearray(LENGTH.unpack(head)[0])
        self.read_into(frame)
        return frame

    def read_into(self, buffer: bytearray) -> None:
        """Reads bytes until a buffer is full.

        Raises:
            EOFError: The parent is gone.
        """
        view = memoryview(buffer)
        while view:
            count = os.readv(self._requests, [view])
            if count == 0:
                raise EOFError
            view = view[count:]

    def write(self, kind: bytes, content: str | bytes = b"") -> None:
        """Sends an answer; a long reason loses its beginning, since a traceback ends with the error."""
        if isinstance(content, str):
            content = content.encode(errors="replace")
        if kind != GOOD:
            content = content[-LONGEST_REASON:]
        frame = LENGTH.pack(1 + len(content)) + kind + content
        while frame:
            frame = frame[os.write(self._answers, frame) :]
