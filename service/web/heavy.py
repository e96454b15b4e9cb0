"""Heavy reads: computed in a few threads of their own, and paid by each caller in processor seconds.

Threads that answer small requests therefore never wait behind them, and callers without a token, who have one of the
threads at most, cannot keep it for long.
"""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AsyncExitStack
from dataclasses import dataclass
from typing import Annotated, Final, Protocol, TypeVar

from fastapi import Depends, Request

from dohyo.service.errors import BusyError, TooManyRequestsError
from dohyo.service.web.addresses import payer_of

AT_ONCE: Final = 2
MOST_WAITING: Final = 64
REMEMBERED: Final = 10_000
T = TypeVar("T")


@dataclass(slots=True)
class _Purse:
    """Processor seconds that a caller may still use, refilled steadily; negative after a costly read."""

    left_s: float
    at: float


class HeavyReads:
    """The threads, and what each caller has used of them."""

    def __init__(self, seconds_per_minute: float, clock: Callable[[], float] = time.monotonic) -> None:
        """Starts with a full purse for everybody."""
        self._most_s, self._clock = seconds_per_minute, clock
        self._purses: OrderedDict[str, _Purse] = OrderedDict()
        self._threads = ThreadPoolExecutor(AT_ONCE, "read")
        self._room, self._anonymous = asyncio.Semaphore(AT_ONCE), asyncio.Semaphore(AT_ONCE - 1)
        self._waiting = 0

    async def compute(self, work: Callable[[], T], payer: str, anonymous: bool) -> T:
        """Result of a computation in one of the threads.

        Args:
            work: What to compute.
            payer: Owner or client whose purse pays for it.
            anonymous: Whether the caller has no token.

        Raises:
            TooManyRequestsError: The purse is empty.
            BusyError: Too many reads wait.
        """
        self._check(payer)
        if self._waiting >= MOST_WAITING:
            raise BusyError("too many costly reads are waiting")
        self._waiting += 1
        try:
            async with AsyncExitStack() as stack:
                if anonymous:
                    await stack.enter_async_context(self._anonymous)
                await stack.enter_async_context(self._room)
                self._check(payer)  # again, since those before may have emptied the purse
                result, seconds = await asyncio.get_running_loop().run_in_executor(self._threads, _timed, work)
                self._purse(payer).left_s -= seconds
        finally:
            self._waiting -= 1
        if isinstance(result, Exception):
            raise result
        return result

    def _check(self, payer: str) -> None:
        left_s = self._purse(payer).left_s
        if left_s <= 0:
            wait_s = (1.0 - left_s) * 60.0 / self._most_s
            raise TooManyRequestsError(f"more than {self._most_s:g} s of computing a minute", retry_s=wait_s)

    def _purse(self, payer: str) -> _Purse:
        now = self._clock()
        purse = self._purses.pop(payer, None) or _Purse(self._most_s, now)
        purse.left_s = min(self._most_s, purse.left_s + (now - purse.at) * self._most_s / 60.0)
        purse.at = now
        self._purses[payer] = purse
        while len(self._purses) > REMEMBERED:
            self._purses.popitem(last=False)
        return purse


class Compute(Protocol):
    """Computes in the heavy reads' threads, paid by the caller of the request."""

    async def __call__(self, work: Callable[[], T]) -> T:
        """Result of a computation."""


def _heavy(request: Request) -> Compute:
    async def compute(work: Callable[[], T]) -> T:
        reads: HeavyReads = request.app.state.services.reads
        anonymous = getattr(request.state, "caller", None) is None
        return await reads.compute(work, payer_of(request), anonymous)

    return compute


Heavy = Annotated[Compute, Depends(_heavy)]


def _timed(work: Callable[[], T]) -> tuple[T | Exception, float]:
    began = time.thread_time()
    try:
        result: T | Exception = work()
    except Exception as error:  # a read that fails is paid for too
        result = error
    return result, time.thread_time() - began
