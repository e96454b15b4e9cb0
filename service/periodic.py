"""Work of the service in the background: what it repeats, such as the removal of old records, and how it ends."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager
from typing import Any

from sqlalchemy.exc import SQLAlchemyError

logger = logging.getLogger("dohyo.service")


@asynccontextmanager
async def repeated(work: Callable[[], object], every_s: float, name: str) -> AsyncIterator[None]:
    """Inside, does the work in a thread at once and then every so often; a failure is logged and tried again.

    Args:
        work: What is done; it blocks, and may be done once more than needed.
        every_s: Time from the end of one to the start of the next, s.
        name: Of the work, for the log.
    """
    task = asyncio.create_task(_repeat(work, every_s, name), name=name)
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


async def _repeat(work: Callable[[], object], every_s: float, name: str) -> None:
    while True:
        try:
            await asyncio.to_thread(work)
        except (SQLAlchemyError, OSError) as error:
            logger.warning("%s failed, trying again in %g s: %s", name, every_s, error)
        except Exception:  # a defect; what else the work is for, such as other owners, must not wait for ever
            logger.exception("%s failed, trying again in %g s", name, every_s)
        await asyncio.sleep(every_s)


async def ended(tasks: Iterable[asyncio.Task[Any]], log: logging.Logger) -> None:
    """Waits until tasks that were cancelled have ended; by what one fails is logged, since nobody else waits for it."""
    for result in await asyncio.gather(*tasks, return_exceptions=True):
        if isinstance(result, Exception):
            log.error("a task failed as the service ended", exc_info=result)
