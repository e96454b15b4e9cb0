"""LoopClock: time in which an event loop reads requests, to measure how long others take.

While the loop stands still, it reads no answer, however early that came. Nobody is charged for this time.
"""

from __future__ import annotations

import time
from typing import Final

LONGEST_PAUSE_S: Final = 0.25
"""Between two ticks; a longer one is a standstill of the loop."""


class LoopClock:
    """Monotonic time, s, without standstills of the loop. Before the first tick none are known."""

    def __init__(self) -> None:
        self._lost_s = 0.0
        self._ticked: float | None = None

    def tick(self) -> None:
        """Says that the loop runs; to be called by a task on it, much more often than every `LONGEST_PAUSE_S`."""
        now = time.monotonic()
        self._lost_s += self._standstill_s(now)
        self._ticked = now

    def monotonic(self) -> float:
        """The time; in a standstill, that of its beginning."""
        now = time.monotonic()
        return now - self._lost_s - self._standstill_s(now)

    def _standstill_s(self, now: float) -> float:
        return 0.0 if self._ticked is None else max(0.0, now - self._ticked - LONGEST_PAUSE_S)
