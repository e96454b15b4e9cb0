"""Retention: removes the files of old records of episodes and worlds, once an hour."""

from __future__ import annotations

import logging
from datetime import timedelta
from typing import Final

from dohyo.service.database.base import now
from dohyo.service.state import Services
from dohyo.service.storage.deletion import remove_records, retire_records
from dohyo.service.worlds.queries import retire_worlds
from dohyo.service.worlds.records import remove_record

EVERY_S: Final = 3600.0

logger = logging.getLogger("dohyo.service")


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
