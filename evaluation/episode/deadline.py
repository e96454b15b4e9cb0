"""Wall-clock deadline for foreign code, such as an agent."""

from __future__ import annotations

import signal
import threading
from contextlib import AbstractContextManager, nullcontext
from types import FrameType, TracebackType
from typing import Final

from dohyo.sumo_networks.errors import AgentTimeoutError

AGAIN_S: Final = 0.5
"""Time after which code that goes on is interrupted again."""
SOON_S: Final = 0.001


class _Expired(BaseException):
    """Raised inside the late code; not an Exception, so that `except Exception` there does not catch it."""


def deadline(seconds: float, what: str) -> AbstractContextManager[None]:
    """Context manager that limits the time of its block; without effect outside the main thread.

    Code that never returns to the Python interpreter is not interrupted; the executor ends its process.

    Args:
        seconds: Wall-clock time allowed.
        what: Name of the code, for the message.

    Raises:
        AgentTimeoutError: The time is over.
    """
    return _Deadline(seconds, what) if threading.current_thread() is threading.main_thread() else nullcontext()


class _Deadline:
    """See `deadline`. No generator: an error raised between its block and its end would leave the timer running."""

    def __init__(self, seconds: float, what: str) -> None:
        """See `deadline`."""
        self._seconds, self._what, self._inside = seconds, what, False

    def __enter__(self) -> None:
        """Sets the timer."""
        self._previous = signal.signal(signal.SIGALRM, self._expire)
        self._inside = True
        signal.setitimer(signal.ITIMER_REAL, self._seconds, AGAIN_S)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stops the timer.

        Raises:
            AgentTimeoutError: It had interrupted the block.
        """
        self._inside = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, self._previous)
        if isinstance(error, _Expired):
            raise AgentTimeoutError(f"{self._what} took longer than {self._seconds:g} s") from None

    def _expire(self, number: int, frame: FrameType | None) -> None:
        """Interrupts the block, and nothing of its edges: what is raised there, nobody would catch."""
        if not self._inside:
            return
        if frame is not None and frame.f_code in _EDGES:
            signal.setitimer(signal.ITIMER_REAL, SOON_S, AGAIN_S)
            return
        raise _Expired


_EDGES: Final = frozenset(one.__code__ for one in (_Deadline.__enter__, _Deadline.__exit__, _Deadline._expire))
