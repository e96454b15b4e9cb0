"""State: shared services of all requests, and the broadcast of events."""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Any, cast

from fastapi import Depends, Request

from dohyo.service.database.base import now
from dohyo.service.database.engine import Database
from dohyo.service.jobs.runner import JobRunner
from dohyo.service.monitoring.metrics import Metrics
from dohyo.service.settings import Settings
from dohyo.service.signing.keys import SigningKeys
from dohyo.service.web.heavy import HeavyWork
from dohyo.service.worlds.book import WorldBook

if TYPE_CHECKING:
    from dohyo.service.scheduling.scheduler import Scheduler

BACKLOG = 256


class Subscription:
    """Unread messages of one topic for one listener, since the creation of this object.

    A listener that falls behind loses the oldest messages; `lagged` then asks it to read the full state again.

    Attributes:
        lagged: Whether messages were lost since it was last set to False.
    """

    def __init__(self, broadcast: Broadcast, topic: str) -> None:
        self.lagged = False
        self._broadcast, self._topic = broadcast, topic
        self._waiting: deque[dict[str, Any]] = deque(maxlen=BACKLOG)
        self._filled = asyncio.Event()
        self._closed = False

    def put(self, message: dict[str, Any]) -> None:
        """Adds a message; on the event loop only."""
        self.lagged = self.lagged or len(self._waiting) == BACKLOG
        self._waiting.append(message)
        self._filled.set()

    async def get(self, timeout_s: float | None = None) -> dict[str, Any] | None:
        """The next message; None after the time-out, or where no more will come (`closed`)."""
        while not self._waiting:
            if self._closed:
                return None
            self._filled.clear()
            try:
                await asyncio.wait_for(self._filled.wait(), timeout_s)
            except TimeoutError:
                return None
        return self._waiting.popleft()

    @property
    def closed(self) -> bool:
        """Whether no message will come any more."""
        return self._closed and not self._waiting

    def close(self) -> None:
        """Stops listening."""
        self._closed = True
        self._filled.set()
        self._broadcast.forget(self._topic, self)

    async def __aiter__(self) -> AsyncIterator[dict[str, Any]]:
        """Yields messages until the subscription is closed."""
        while not self.closed:
            message = await self.get()
            if message is not None:
                yield message

    def __enter__(self) -> Subscription:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Broadcast:
    """Messages by topic, such as "evaluation:ev-..." and "evaluations", for all current listeners."""

    def __init__(self) -> None:
        self._subscriptions: dict[str, set[Subscription]] = {}
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ended = False
        self._watchers: list[Callable[[str, dict[str, Any]], None]] = []

    def watch(self, watcher: Callable[[str, dict[str, Any]], None]) -> None:
        """Calls a function with each topic and message from now on, in the thread that sends it."""
        self._watchers.append(watcher)

    def publish(self, topic: str, data: dict[str, Any]) -> None:
        """Sends a message to all listeners of a topic; callable from any thread, never blocks."""
        for watcher in self._watchers:
            watcher(topic, data)
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            if self._loop is not None and not self._loop.is_closed():
                self._loop.call_soon_threadsafe(self._deliver, topic, data)
            return
        self._deliver(topic, data)

    def subscribe(self, topic: str) -> Subscription:
        """Subscribes to a topic; an async iterator and a context manager. On the event loop only."""
        self._loop = asyncio.get_running_loop()
        subscription = Subscription(self, topic)
        if self._ended:
            subscription.close()
            return subscription
        self._subscriptions.setdefault(topic, set()).add(subscription)
        return subscription

    def forget(self, topic: str, subscription: Subscription) -> None:
        """Removes a listener."""
        listeners = self._subscriptions.get(topic, set())
        listeners.discard(subscription)
        if not listeners:
            self._subscriptions.pop(topic, None)

    def close(self) -> None:
        """Ends all subscriptions, so that no open stream keeps the service from ending."""
        self._ended = True
        for subscription in [one for listeners in self._subscriptions.values() for one in listeners]:
            subscription.close()

    def _deliver(self, topic: str, data: dict[str, Any]) -> None:
        for subscription in tuple(self._subscriptions.get(topic, ())):
            subscription.put(data)


@dataclass(slots=True)
class Services:
    """Services shared by all requests, in `app.state.services`.

    Attributes:
        settings: Settings of the service.
        database: Database.
        scheduler: Scheduler that drives episodes.
        events: Broadcast of events.
        started: Start time.
        draining: Whether the service is shutting down and accepts no new work.
        lost: Called, in a thread, once another server has this one's database.
        metrics: Counts and durations for Prometheus.
        jobs: Runner of jobs.
        reads: Threads of heavy reads.
        orders: Threads of orders.
        bodies: Threads that parse long bodies.
        signing: Keys that sign records.
        worlds: Live worlds.
        streams: Number of open event streams by caller.
        uploads: Number of uploads under way by caller.
    """

    settings: Settings
    database: Database
    scheduler: Scheduler
    events: Broadcast
    started: datetime = field(default_factory=now)
    draining: bool = False
    lost: Callable[[], None] = lambda: None
    metrics: Metrics = field(default_factory=Metrics)
    streams: Counter[str] = field(default_factory=Counter)
    uploads: Counter[str] = field(default_factory=Counter)
    jobs: JobRunner = field(init=False)
    reads: HeavyWork = field(init=False)
    orders: HeavyWork = field(init=False)
    bodies: HeavyWork = field(init=False)
    signing: SigningKeys = field(init=False)
    worlds: WorldBook = field(init=False)

    def __post_init__(self) -> None:
        self.events.watch(self.metrics.note_event)
        seconds = self.settings.read_seconds_per_minute
        self.reads, self.orders = HeavyWork("reads", seconds), HeavyWork("orders", seconds)
        self.bodies = HeavyWork("bodies", seconds)
        self.jobs = JobRunner(self.settings, self.database, self.events)
        self.worlds = WorldBook(self.settings, self.database)
        self.signing = SigningKeys(self.settings.signing_key, self.settings.retired_signing_keys)

    async def drain(self) -> None:
        """Waits for running episodes while their workers are still served, then ends all open streams."""
        if not self.draining:
            self.draining = True
            await self.jobs.stop()
            await asyncio.gather(self.scheduler.stop(), self.worlds.stop())
            self.events.close()


async def services_of(request: Request) -> Services:
    """The services of the app that got a request."""
    return cast(Services, request.app.state.services)


ServicesOf = Annotated[Services, Depends(services_of)]
