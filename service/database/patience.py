"""PatientDatabase: uses of the database that wait while it is locked, full or unreachable."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from itertools import chain, repeat
from typing import TYPE_CHECKING, TypeVar

from sqlalchemy.exc import OperationalError
from sqlalchemy.exc import TimeoutError as NoConnectionError
from sqlalchemy.orm import Session

if TYPE_CHECKING:
    from dohyo.service.database.engine import Database

RETRY_S = (0.5, 1.0, 2.0, 5.0, 10.0)
REFUSALS = (OperationalError, NoConnectionError, OSError)
"""Errors that pass: the database is locked, full or unreachable, or all connections are in use."""
T = TypeVar("T")

logger = logging.getLogger("dohyo.database")


class PatientDatabase:
    """A database for an event loop that never waits for it.

    Attributes:
        stopped: Whether the service has stopped, so that a refusal is an error.
    """

    def __init__(self, database: Database) -> None:
        """Wraps a database."""
        self.stopped = False
        self._database = database

    async def read(self, query: Callable[[Session], T], patient: bool = True) -> T:
        """Reads from the database in a thread.

        Raises:
            OperationalError, NoConnectionError, OSError: The database refuses, and the service has stopped or the
                caller is not patient.
        """

        def once() -> T:
            with self._database.reading() as session:
                return query(session)

        return await self._patiently(once, patient)

    async def change(self, change: Callable[[Session], T], patient: bool = True) -> T:
        """Changes the database in one transaction, in a thread.

        Raises:
            OperationalError, NoConnectionError, OSError: The database refuses, and the service has stopped or the
                caller is not patient.
        """

        def once() -> T:
            with self._database.session() as session:
                return change(session)

        return await self._patiently(once, patient)

    async def use(self, work: Callable[[Database], T], patient: bool = True) -> T:
        """Does work that has its own transactions, in a thread; after a refusal all of it is done again.

        Raises:
            OperationalError, NoConnectionError, OSError: The database refuses, and the service has stopped or the
                caller is not patient.
        """
        return await self._patiently(lambda: work(self._database), patient)

    async def _patiently(self, once: Callable[[], T], patient: bool) -> T:
        for pause in chain(RETRY_S, repeat(RETRY_S[-1])):
            try:
                return await asyncio.to_thread(once)
            except REFUSALS as error:
                if self.stopped or self._database.given_up or not patient:
                    raise
                logger.warning("the database refuses, trying again: %s", error)
                await asyncio.sleep(pause)
        raise AssertionError("unreachable: the pauses never end")
