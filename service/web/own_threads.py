"""Threads of one purpose, so that its work never waits behind uploads and other long requests, and never takes them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from anyio import CapacityLimiter, to_thread
from anyio.lowlevel import RunVar

T = TypeVar("T")


class OwnThreads:
    """At most so many threads at once in an event loop; further work waits for one of them."""

    def __init__(self, purpose: str, most: int) -> None:
        self._limiter: RunVar[CapacityLimiter] = RunVar(f"threads for {purpose}")
        self._most = most

    async def run(self, work: Callable[[], T]) -> T:
        """What `work` returns or raises, called in one of the threads."""
        limiter = self._limiter.get(None)
        if limiter is None:
            self._limiter.set(limiter := CapacityLimiter(self._most))
        return await to_thread.run_sync(work, limiter=limiter)
