"""ForkedProcess: handle of a copy of a fork server, with the methods of `subprocess.Popen` that are needed here."""

from __future__ import annotations

import os
import select
import signal
import struct
import subprocess
import time
import weakref
from threading import Lock
from typing import Final

NUMBER: Final = struct.Struct("<i")
"""Numbers that a fork server writes to the pipe of a process: its identifier, then its exit code."""


class ForkedProcess:
    """A process whose parent is the fork server.

    It keeps its number, and its group too, until this handle is released: no signal reaches another process.

    Attributes:
        pid: Identifier of the process.
        returncode: Exit code once `poll` or `wait` has seen it; negative: the signal that ended it.
        release: Lets the fork server forget the process; a second call has no effect.
    """

    def __init__(self, pipe: int) -> None:
        """Waits for the process to exist.

        Args:
            pipe: Read end of its pipe, which this handle closes.

        Raises:
            OSError: The fork server has ended.
        """
        self.release = weakref.finalize(self, os.close, pipe)
        self.returncode: int | None = None
        self._pipe, self._reading = pipe, Lock()
        if (pid := _number(pipe)) is None:
            self.release()
            raise ChildProcessError("the fork server has ended")
        self.pid = pid

    def poll(self) -> int | None:
        """Exit code; None: the process still runs."""
        return self._look(0.0)

    def wait(self, timeout: float | None = None) -> int:
        """Waits for the end of the process and returns its exit code.

        Raises:
            subprocess.TimeoutExpired: It still runs after so many seconds.
        """
        code = self._look(timeout)
        if code is None:
            raise subprocess.TimeoutExpired([str(self.pid)], timeout or 0.0)
        return code

    def kill(self) -> None:
        """Sends SIGKILL."""
        self.send_signal(signal.SIGKILL)

    def send_signal(self, number: int) -> None:
        """Sends a signal, unless the process has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def _look(self, timeout_s: float | None) -> int | None:
        # One thread reads at a time: a second one in `poll` would sleep on when the first has emptied the pipe.
        ends = None if timeout_s is None else time.monotonic() + timeout_s
        if self.returncode is None and self._reading.acquire(timeout=-1.0 if timeout_s is None else timeout_s):
            try:
                if self.returncode is None and self.release.alive and self._readable(ends):
                    code = _number(self._pipe)
                    # A fork server that was ended takes its copies with it.
                    self.returncode = -signal.SIGKILL if code is None else code
            finally:
                self._reading.release()
        return self.returncode

    def _readable(self, ends: float | None) -> bool:
        ready = select.poll()
        ready.register(self._pipe, select.POLLIN)
        return bool(ready.poll(None if ends is None else max(ends - time.monotonic(), 0.0) * 1000.0))


def _number(pipe: int) -> int | None:
    """The next number in a pipe; None at its end."""
    content = os.read(pipe, NUMBER.size)
    return int(NUMBER.unpack(content)[0]) if content else None
