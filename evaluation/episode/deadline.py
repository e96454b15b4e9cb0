"""Wall-clock deadline for foreign code, such as an agent."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from dohyo.sumo_networks.errors import AgentTimeoutError


class _Expired(BaseException):
    """Raised inside the late code; not an Exception, so that `except Exception` there does not catch it."""


@contextmanager
def deadline(seconds: float, what: str) -> Iterator[None]:
    """Context manager that limits the time of its block; without effect outside the main thread.

    Code that never returns to the Python interpreter is not interrupted; the executor ends its process.

    Args:
        seconds: Wall-clock time allowed.
        what: Name of the code, for the message.

    Raises:
        AgentTimeoutError: The time is over.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    inside = True

    def expire(number: int, frame: FrameType | None) -> None:
        if inside:  # the signal may come between the end of the block and that of the timer
            raise _Expired

    previous = signal.signal(signal.SIGALRM, expire)
    try:
        signal.setitimer(signal.ITIMER_REAL, seconds, 0.5)
        yield
    except _Expired:
        raise AgentTimeoutError(f"{what} took longer than {seconds:g} s") from None
    finally:
        inside = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)
