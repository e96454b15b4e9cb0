"""Retention: removes the files of old records of episodes and worlds, once an hour."""

from __future__ import annotations

import logging
import time
from datetime import timedelta
from typing import Final

from dohyo.service.database.base import now
from dohyo.service.state import Services
from dohyo.service.storage.deletion import remove_records, retire_records
from dohyo.service.worlds.queries import retire_worlds
from dohyo.service.worlds.records import remove_record

EVERY_S: Final = 3600.0
SET_S: Final = 300.0
"""A clock that has gained or lost more between two passes was set."""

logger = logging.getLogger("dohyo.service")


class Retention:
    """The passes of one service. The first after the clock was set removes nothing: what goes is gone for good."""

    def __init__(self, services: Services) -> None:
        """Remembers the clock."""
        self._services, self._ahead_s = services, _ahead_s()

    def remove(self) -> int:
        """See `remove_old_records`; 0 where the clock was set since the last pass."""
        before, self._ahead_s = self._ahead_s, _ahead_s()
        if abs(self._ahead_s - before) > SET_S:
            logger.warning("the clock was set by %.0f s: no old records are removed now", self._ahead_s - before)
            return 0
        return remove_old_records(self._services)


def _ahead_s() -> float:
    """The time of the day beyond that since the machine's start, s; both run alike unless the clock is set."""
    return now().timestamp() - time.monotonic()


def remove_old_records(services: Services) -> int:
    """Removes the records of evaluations and worlds that finished too long ago; returns how many."""
    days = services.settings.records_kept_days
    if days is None:
        return 0
    before = now() - timedelta(days=days)
    with services.database.session() as session:
        hashes, worlds = retire_records(session, before), retire_worlds(session, before)
    remove_records(services.settings, services.database, hashes)
    for identifier in worlds:
        remove_record(services.settings, identifier)
    if removed := len(hashes) + len(worlds):
        logger.info("removed %d records that are older than %g days", removed, days)
    return removed
