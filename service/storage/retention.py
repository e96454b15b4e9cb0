"""Retention: removes the files of old records, once an hour."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from datetime import timedelta

from sqlalchemy.exc import SQLAlchemyError

from dohyo.service.database.base import now
from dohyo.service.state import Services
from dohyo.service.storage.deletion import remove_records, retire_records

EVERY_S = 3600.0

logger = logging.getLogger("dohyo.service")


class Retention:
    """Removes records after `records_kept_days`, until the service ends."""

    def __init__(self, services: Services) -> None:
        self._services = services
        self._task: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Starts, unless records are kept for ever."""
        if self._services.settings.records_kept_days is not None:
            self._task = asyncio.create_task(self._run())

    async def stop(self) -> None:
        """Stops."""
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task

    async def _run(self) -> None:
        while True:
            try:
                await asyncio.to_thread(remove_old_records, self._services)
            except (SQLAlchemyError, OSError) as error:
                logger.warning("old records cannot be removed: %s", error)
            await asyncio.sleep(EVERY_S)


def remove_old_records(services: Services) -> int:
    """Removes the records of evaluations that finished too long ago; returns how many."""
    days = services.settings.records_kept_days
    if days is None:
        return 0
    with services.database.session() as session:
        hashes = retire_records(session, now() - timedelta(days=days))
    remove_records(services.settings, hashes)
    if hashes:
        logger.info("removed %d records that are older than %g days", len(hashes), days)
    return len(hashes)
