"""Heavy work of requests: done in a few threads of its own, and paid by each caller in processor seconds.

Threads that answer small requests therefore never wait behind it. Callers take turns: each has one request at a time,
so that a caller with many of them delays any other one by a single one. Callers without a token have all threads but
one, and places of their own to wait in. Reads and orders are apart, so that neither waits for the other.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter, OrderedDict
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from functools import partial, wraps
from inspect import Parameter, signature
from typing import Annotated, Any, Final, Protocol, TypeVar

from fastapi import Depends, Request

from dohyo.service.errors import BusyError, TooManyRequestsError
from dohyo.service.web.addresses import payer_of

AT_ONCE: Final = 2
MOST_WAITING: Final = 256  # of callers without a token; as many of those with one
MOST_WAITING_PER_CALLER: Final = 32  # an address may be that of a whole class
REMEMBERED: Final = 10_000
T = TypeVar("T")


@dataclass(slots=True)
class _Purse:
    """Processor seconds that a caller may still use, refilled steadily; negative after a costly read."""

    left_s: float
    at: float


@dataclass(slots=True)
class _Queue:
    """Requests of one caller that have not ended, and the turn that they take one after another."""

    requests: int = 0
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)


class HeavyWork:
    """Threads for one kind of requests, and what each caller has used of them."""

    def __init__(self, kind: str, seconds_per_minute: float, clock: Callable[[], float] = time.monotonic) -> None:
        """Starts with a full purse for everybody.

        Args:
            kind: Such as "reads", for messages.
            seconds_per_minute: Processor seconds that a caller may use.
            clock: Time, s.
        """
        self._kind, self._most_s, self._clock = kind, seconds_per_minute, clock
        self._purses: OrderedDict[str, _Purse] = OrderedDict()
        self._threads = ThreadPoolExecutor(AT_ONCE, kind)
        self._room, self._anonymous = asyncio.Semaphore(AT_ONCE), asyncio.Semaphore(AT_ONCE - 1)
        self._queues: dict[str, _Queue] = {}
        self._waiting: Counter[bool] = Counter()

    async def compute(self, work: Callable[[], T], payer: str, anonymous: bool) -> T:
        """Result of a computation in one of the threads.

        Args:
            work: What to compute.
            payer: Owner or client whose purse pays for it.
            anonymous: Whether the caller has no token.

        Raises:
            TooManyRequestsError: The purse is empty, or too many requests of this payer wait.
            BusyError: Too many requests wait.
        """
        self._check(payer)
        async with self._turn(payer, anonymous), AsyncExitStack() as stack:
            if anonymous:
                await stack.enter_async_context(self._anonymous)
            await stack.enter_async_context(self._room)
            self._check(payer)  # again, since those before may have emptied the purse
            result, seconds = await asyncio.get_running_loop().run_in_executor(self._threads, _timed, work)
            self._purse(payer).left_s -= seconds
        if isinstance(result, Exception):
            raise result
        return result

    @asynccontextmanager
    async def _turn(self, payer: str, anonymous: bool) -> AsyncIterator[None]:
        """Waits until no other request of the payer is computed or stands before a thread."""
        if self._waiting[anonymous] >= MOST_WAITING:
            raise BusyError(f"too many costly {self._kind} are waiting")
        queue = self._queues.setdefault(payer, _Queue())
        if queue.requests >= MOST_WAITING_PER_CALLER:
            raise TooManyRequestsError(f"at most {MOST_WAITING_PER_CALLER} costly {self._kind} at once")
        queue.requests += 1
        self._waiting[anonymous] += 1
        try:
            async with queue.turn:
                yield
        finally:
            self._waiting[anonymous] -= 1
            queue.requests -= 1
            if not queue.requests:
                del self._queues[payer]

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
        reads: HeavyWork = request.app.state.services.reads
        anonymous = getattr(request.state, "caller", None) is None
        return await reads.compute(work, payer_of(request), anonymous)

    return compute


Heavy = Annotated[Compute, Depends(_heavy)]


def heavy_read(endpoint: Callable[..., T]) -> Callable[..., Awaitable[T]]:
    """A route whose whole work is a heavy read."""

    @wraps(endpoint)
    async def route(*, heavy: Compute, **values: Any) -> T:
        return await heavy(partial(endpoint, **values))

    plain = signature(endpoint, eval_str=True)
    paid = Parameter("heavy", Parameter.KEYWORD_ONLY, annotation=Heavy)
    route.__signature__ = plain.replace(parameters=[*plain.parameters.values(), paid])  # type: ignore[attr-defined]
    return route


def _timed(work: Callable[[], T]) -> tuple[T | Exception, float]:
    began = time.thread_time()
    try:
        result: T | Exception = work()
    except Exception as error:  # what fails is paid for too
        result = error
    return result, time.thread_time() - began
