"""Patience: a change that is repeated while the database is locked, full or unreachable."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from itertools import chain, repeat
from typing import TypeVar

from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from dohyo.service.database.engine import Database

RETRY_S = (0.5, 1.0, 2.0, 5.0, 10.0)
T = TypeVar("T")

logger = logging.getLogger("dohyo.service")


async def patiently(database: Database, change: Callable[[Session], T], ended: Callable[[], bool]) -> T:
    """Result of a transaction that is tried until it succeeds, or until the caller has `ended`.

    Raises:
        OperationalError: The database refuses, and the caller has ended.
        OSError: The same.
    """

    def once() -> T:
        with database.session() as session:
            return change(session)

    for pause in chain(RETRY_S, repeat(RETRY_S[-1])):
        try:
            return await asyncio.to_thread(once)
        except (OperationalError, OSError) as error:
            if ended():
                raise
            logger.warning("the database refuses, trying again: %s", error)
            await asyncio.sleep(pause)
    raise AssertionError("unreachable: the pauses never end")
