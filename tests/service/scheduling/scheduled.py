"""A scheduler in this process, on the data of a service: for tests of what comes between two of its steps."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

from dohyo.service.database.engine import BUSY_S, Database
from dohyo.service.scheduling.scheduler import Scheduler
from dohyo.service.state import Broadcast
from dohyo.service.submissions.model import AgentKind
from tests.service.served import PATIENCE_S, STEADY, Service, info_of, short


@asynccontextmanager
async def scheduled(shop: Service, events: Broadcast | None = None, busy_s: float = BUSY_S) -> AsyncIterator[Scheduler]:
    """A scheduler in this process, and the time after which a busy database refuses it."""
    database = Database(shop.settings.database_url, busy_s=busy_s)
    scheduler = Scheduler(shop.settings, database, events or Broadcast())
    await scheduler.start()
    try:
        yield scheduler
    finally:
        await scheduler.stop()
        database.close()


async def until(true: Callable[[], bool], patience_s: float = PATIENCE_S) -> None:
    """Waits until something holds, on the event loop."""
    ends = time.monotonic() + patience_s
    while not await asyncio.to_thread(true):
        assert time.monotonic() < ends, "it does not happen"
        await asyncio.sleep(0.05)


def submit(shop: Service, name: str, missions: int = 1, owner: str = "owner") -> str:
    info = info_of(STEADY).model_copy(update={"name": name})
    return shop.submit(info, short(missions), kind=AgentKind.BUILTIN, owner=owner)


class Stop:
    """A step of the scheduler that stands still at its next call until it may go on."""

    def __init__(self, real: Callable[..., Any]) -> None:
        self.reached, self.may_go_on = threading.Event(), threading.Event()
        self._real = real

    def __call__(self, *arguments: Any) -> Any:
        self.reached.set()
        assert self.may_go_on.wait(PATIENCE_S)
        return self._real(*arguments)
