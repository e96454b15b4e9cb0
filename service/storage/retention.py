"""Retention: removes the files of old records, once an hour."""

from __future__ import annotations

import logging
from datetime import timedelta
from typing import Final

from dohyo.service.database.base import now
from dohyo.service.state import Services
from dohyo.service.storage.deletion import remove_records, retire_records

EVERY_S: Final = 3600.0

logger = logging.getLogger("dohyo.service")


def remove_old_records(services: Services) -> int:
    """Removes the records of evaluations that finished too long ago; returns how many."""
    days = services.settings.records_kept_days
    if days is None:
        return 0
    with services.database.session() as session:
        hashes = retire_records(session, now() - timedelta(days=days))
    remove_records(services.settings, services.database, hashes)
    if hashes:
        logger.info("removed %d records that are older than %g days", len(hashes), days)
    return len(hashes)
