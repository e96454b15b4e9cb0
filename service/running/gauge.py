"""Gauge: what an episode process shows of its order in shared memory, so that the server reads it without waiting."""

from __future__ import annotations

import mmap
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

_DUE, _BEGAN, _AGENT, _EGO, _SLOWEST, _CALLED = range(6)  # float64 each
GAUGE_BYTES: Final = 48


class Gauge:
    """Times of one order, s; the process writes them, the server reads them."""

    def __init__(self, descriptor: int) -> None:
        """Maps a file of `GAUGE_BYTES` that both processes have open."""
        self._values = memoryview(mmap.mmap(descriptor, GAUGE_BYTES)).cast("d")
        self._taken_s = dict[int, float]()

    @property
    def due(self) -> float:
        """Moment on the monotonic clock by which the agent must have returned; 0 while none is called."""
        return self._values[_DUE]

    @property
    def began(self) -> float:
        """Moment on the monotonic clock at which the drive began; 0 before, such as while it waits for a worker."""
        return self._values[_BEGAN]

    @property
    def agent_s(self) -> float:
        """Wall-clock time that the agent has taken for its decisions, without one that it still makes."""
        return self._values[_AGENT]

    @property
    def deciding_s(self) -> float:
        """Wall-clock time of the decision that the agent still makes; 0 while none is called."""
        called = self._values[_CALLED]
        return time.monotonic() - called if called else 0.0

    @property
    def ego(self) -> int:
        """Number of the ego whose agent was called last."""
        return int(self._values[_EGO])

    @property
    def slowest(self) -> int:
        """Number of the ego whose agent has taken the most time."""
        return int(self._values[_SLOWEST])

    def clear(self) -> None:
        """A new order begins."""
        self._taken_s = {}
        for place in (_DUE, _BEGAN, _AGENT, _EGO, _SLOWEST, _CALLED):
            self._values[place] = 0.0

    def begin(self) -> None:
        """The drive begins."""
        self._values[_BEGAN] = time.monotonic()

    def watch(self, seconds: float, ego: int = 0) -> None:
        """The agent of an ego is called and may take so long; 0: it has returned."""
        now = time.monotonic()
        called = self._values[_CALLED]
        if seconds:
            self._values[_CALLED] = now
            self._values[_EGO] = ego
            self._values[_DUE] = now + seconds
        elif called:
            self._values[_DUE] = 0.0
            self._values[_AGENT] += now - called
            self._values[_CALLED] = 0.0
            self._taken_s[self.ego] = self._taken_s.get(self.ego, 0.0) + now - called
            self._values[_SLOWEST] = max(self._taken_s, key=self._taken_s.__getitem__)

    def watch_worker(self, seconds: float, ego: int = 0) -> None:
        """The same for an agent elsewhere: the server knows its deadlines, and it begins with the first decision."""
        if seconds and not self.began:
            self.begin()
        self.watch(seconds, ego)
        self._values[_DUE] = 0.0


@contextmanager
def watched(watch: Callable[[float], None], seconds: float) -> Iterator[None]:
    """Meanwhile an agent is called, which may take so long; `watch` is that of a gauge, or its `watch_worker`."""
    watch(seconds)
    try:
        yield
    finally:
        watch(0.0)
