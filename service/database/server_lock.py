"""One server per database: a lock, which refuses a second server and stops a server that has lost it.

The queue's turns, the leases of workers and the limits of callers are in the memory of one process, so two servers on
one database would drive the same episodes. PostgreSQL holds the lock for as long as a connection of its own lives;
beside SQLite it is a locked file. Both end with the process, also by kill -9.
"""

from __future__ import annotations

import logging
import os
import platform
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Final, Protocol

from filelock import FileLock, Timeout
from sqlalchemy import Connection, NullPool, String, create_engine, func, select, text
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Mapped, mapped_column

from dohyo.service.database.base import Base, now
from dohyo.service.database.engine import Database, surviving, usable
from dohyo.sumo_networks.errors import InvalidInputError

WATCH_S: Final = 1.0
RELEASE_S: Final = 2.0  # time in which PostgreSQL notices that a killed server is gone
APPLICATION: Final = "dohyo server"
_KEY: Final = 0x0D0E_0500

logger = logging.getLogger("dohyo.service")


class Server(Base):
    """One start of a server; the newest row is the server that may write."""

    __tablename__ = "servers"

    id: Mapped[int] = mapped_column(primary_key=True)
    host: Mapped[str] = mapped_column(String(255))
    process: Mapped[int]
    started: Mapped[datetime] = mapped_column(default=now)


class _Lock(Protocol):
    def take(self) -> bool:
        """Takes the lock; returns whether it was free."""

    def held(self) -> bool:
        """Whether this process still has the lock."""

    def release(self) -> None:
        """Gives the lock back."""


class ServerLock:
    """The lock of one database, held by this process.

    Attributes:
        generation: Number of this start of a server.
    """

    def __init__(self, database: Database, lost: Callable[[], None]) -> None:
        """Prepares the lock.

        Args:
            database: Database to lock; it refuses to write while the lock is away.
            lost: Called, in a thread, once another server has the lock.
        """
        self.generation = 0
        self._database, self._lost = database, lost
        self._lock: _Lock = _FileLock(database) if database.is_sqlite else _AdvisoryLock(database)
        self._ended = threading.Event()
        self._watcher = threading.Thread(target=self._watch, name="server-lock", daemon=True)

    def take(self) -> None:
        """Takes the lock.

        Raises:
            InvalidInputError: Another server has it.
        """
        deadline = time.monotonic() + RELEASE_S
        while not self._take():
            if time.monotonic() >= deadline:
                raise InvalidInputError(
                    f"database: another server uses it{self._holder()}; expected one server per database: stop that"
                    " server, or choose another --database"
                )
            time.sleep(0.1)

    def _take(self) -> bool:
        with usable():
            return self._lock.take()

    def watch(self) -> None:
        """Registers this start, then watches the lock in a thread."""
        with self._database.session() as session:
            server = Server(host=platform.node()[:255], process=os.getpid())
            session.add(server)
            session.flush()
            self.generation = server.id
        self._watcher.start()

    def release(self) -> None:
        """Ends the thread and gives the lock back."""
        self._ended.set()
        if self._watcher.is_alive():
            self._watcher.join()
        self._lock.release()

    def _watch(self) -> None:
        while not self._ended.wait(WATCH_S):
            if self._lock.held():
                continue
            self._database.fenced = True
            logger.error("the lock of the database is lost; nothing is written without it")
            if not self._regain():
                break

    def _regain(self) -> bool:
        """Takes the lock again, when the database answers; returns whether this server may go on."""
        while not self._ended.wait(WATCH_S):
            try:
                mine = self._lock.take() and self._newest() == self.generation
            except (SQLAlchemyError, OSError):
                continue  # nobody can write to a database that does not answer
            if not mine:
                logger.critical("another server has taken the database%s: this one ends", self._holder())
                self._lost()
                return False
            self._database.fenced = False
            logger.warning("the lock of the database is held again")
            return True
        return False

    def _newest(self) -> int | None:
        with self._database.reading() as session:
            return session.scalar(select(func.max(Server.id)))

    def _holder(self) -> str:
        try:
            with self._database.reading() as session:
                server = session.scalars(select(Server).order_by(Server.id.desc()).limit(1)).first()
        except SQLAlchemyError:
            server = None  # the tables are not made yet
        return f" (host {server.host}, process {server.process})" if server else ""


@contextmanager
def server_lock(database: Database, lost: Callable[[], None] = lambda: None) -> Iterator[ServerLock]:
    """Holds the lock until the end of the block, and migrates the tables under it.

    Args:
        database: Database to serve.
        lost: Called, in a thread, once another server has the lock.

    Raises:
        InvalidInputError: Another server has the lock, the tables are of another version, or the database cannot be
            used.
    """
    lock = ServerLock(database, lost)
    lock.take()
    try:
        with usable():
            database.migrate()
        yield lock
    finally:
        lock.release()


class _AdvisoryLock:
    """A session's advisory lock of PostgreSQL, on a connection that is used for nothing else."""

    def __init__(self, database: Database) -> None:
        arguments = {**surviving(""), "application_name": APPLICATION, "connect_timeout": 5}
        self._engine = create_engine(
            database.engine.url, poolclass=NullPool, isolation_level="AUTOCOMMIT", connect_args=arguments
        )
        self._connection: Connection | None = None
        self._backend = 0

    def take(self) -> bool:
        self.release()
        connection = self._engine.connect()
        if not connection.scalar(text("SELECT pg_try_advisory_lock(:key)"), {"key": _KEY}):
            connection.close()
            return False
        self._connection, self._backend = connection, self._asked(connection)
        return True

    def held(self) -> bool:
        """Whether the session lives; behind a pool of transactions the next statement has another session."""
        try:
            return self._connection is not None and self._asked(self._connection) == self._backend
        except SQLAlchemyError:
            return False

    def release(self) -> None:
        if self._connection is not None:
            self._connection.invalidate()
            self._connection.close()
            self._connection = None

    @staticmethod
    def _asked(connection: Connection) -> int:
        return int(connection.scalar(text("SELECT pg_backend_pid()")) or 0)


class _FileLock:
    """A locked file beside the file of SQLite."""

    def __init__(self, database: Database) -> None:
        self._path = Path(f"{Path(database.engine.url.database or '').resolve()}.lock")
        self._lock: FileLock | None = None
        self._inode = 0

    def take(self) -> bool:
        self.release()
        lock = FileLock(self._path, blocking=False, thread_local=False)
        try:
            lock.acquire()
        except Timeout:
            return False
        self._lock, self._inode = lock, self._path.stat().st_ino
        return True

    def held(self) -> bool:
        """Whether the file is still the one that this process has locked."""
        try:
            return self._path.stat().st_ino == self._inode
        except OSError:
            return False

    def release(self) -> None:
        if self._lock is not None:
            self._lock.release(force=True)
            self._lock = None
