"""Engine: connections to SQLite or PostgreSQL, transactions, and migrations at the start."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from alembic import command
from alembic.config import Config as AlembicConfig
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url, text
from sqlalchemy.exc import ArgumentError, OperationalError, SQLAlchemyError
from sqlalchemy.orm import Session

from dohyo.sumo_networks.errors import InvalidInputError

MIGRATIONS = Path(__file__).with_name("migrations")
BUSY_S = 5.0
WAL_RETRY_S = 0.01
_LOCK = 0x0D0E_0400  # key of PostgreSQL's advisory lock during migrations
_ENQUEUE_LOCK = _LOCK + 1


class FencedError(OperationalError):
    """This server's lock on the database is away, so that it may not write; it is repeated as any other refusal."""

    def __init__(self) -> None:
        super().__init__("BEGIN", {}, RuntimeError("this server has lost its lock on the database"))


class Database:
    """One database and its pool of connections; safe to use from any thread.

    Attributes:
        engine: Engine of SQLAlchemy.
        fenced: Whether nothing may be written, since this server's lock is away (`server_lock`).
        given_up: Whether the start was ended by a signal, so that nothing waits for a database that refuses.
    """

    def __init__(self, url: str, *, busy_s: float = BUSY_S, pool: int = 20) -> None:
        """Prepares the engine, which connects at the first use.

        Args:
            url: SQLAlchemy URL of SQLite or PostgreSQL.
            busy_s: Seconds that a transaction waits for the lock of another one.
            pool: Connections at once; FastAPI has 40 threads, few of which are in the database at one moment.

        Raises:
            InvalidInputError: This is no URL, or one of another kind of database, or of one in memory, which stores
                nothing.
        """
        self.engine = _make_engine(url, busy_s, pool)
        self.fenced = self.given_up = False
        self.is_sqlite = self.engine.dialect.name == "sqlite"
        self._writing = self.engine.execution_options(dohyo_write=True)

    @contextmanager
    def session(self) -> Iterator[Session]:
        """A transaction that may write; commits at the end and rolls back after an exception.

        On SQLite its first statement takes the write lock: one that reads first and writes later could never be
        completed if another wrote in between.

        Raises:
            FencedError: This server's lock is away.
        """
        self._check_fence()
        with Session(self._writing, expire_on_commit=False) as session, session.begin():
            yield session
            self._check_fence()

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """A transaction that only reads; never waits for one that writes."""
        with Session(self.engine, expire_on_commit=False, autoflush=False) as session:
            yield session

    def is_migrated(self) -> bool:
        """Whether the tables are those of the current models.

        Raises:
            InvalidInputError: Another version of dohyo made the tables, and no migration leads from them.
        """
        scripts = ScriptDirectory.from_config(_migrations())
        with self.engine.connect() as connection:
            return _check_revision(connection, scripts) == set(scripts.get_heads())

    def migrate(self) -> None:
        """Migrates the tables to the current models; services that start at the same time wait for each other.

        Raises:
            InvalidInputError: Another version of dohyo made the tables, and no migration leads from them; or the
                database cannot store every text.
        """
        config = _migrations()
        with self._writing.begin() as connection:
            if not self.is_sqlite:
                _check_encoding(connection)
                connection.execute(text("SELECT pg_advisory_xact_lock(:lock)"), {"lock": _LOCK})
            _check_revision(connection, ScriptDirectory.from_config(config))
            config.attributes["connection"] = connection
            command.upgrade(config, "head")

    def check(self) -> None:
        """Runs a trivial query to check the connection."""
        with self.reading() as session:
            session.execute(text("SELECT 1"))

    def close(self) -> None:
        """Closes all connections."""
        self.engine.dispose()

    def _check_fence(self) -> None:
        if self.fenced:
            raise FencedError()


@contextmanager
def usable() -> Iterator[None]:
    """Tells in one line of a database that cannot be used.

    Raises:
        InvalidInputError: The database does not answer, has no room, or is none.
    """
    try:
        yield
    except (SQLAlchemyError, OSError) as error:
        reason = str(getattr(error, "orig", error)).strip().partition("\n")[0]
        raise InvalidInputError(f"database: it cannot be used: {reason}") from error


def serialise(session: Session) -> None:
    """Locks until the end of the transaction, so that a count stays valid."""
    if session.get_bind().dialect.name == "postgresql":
        session.execute(text("SELECT pg_advisory_xact_lock(:lock)"), {"lock": _ENQUEUE_LOCK})


def surviving(options: str) -> dict[str, str | int]:
    """Arguments of a connection to PostgreSQL, in UTF-8; within half a minute both sides notice a network that is gone.

    Args:
        options: Further options of the session, as on PostgreSQL's command line.
    """
    keep_alive = {"keepalives_idle": 10, "keepalives_interval": 5, "keepalives_count": 3}
    theirs = [f"-c tcp_{name}={value}" for name, value in keep_alive.items()]
    # Without it, the driver gives bytes where the database is of SQL_ASCII.
    spoken: dict[str, str | int] = {"client_encoding": "utf8"}
    return spoken | {"options": " ".join([options, *theirs]), "tcp_user_timeout": 10_000, **keep_alive}


def _migrations() -> AlembicConfig:
    config = AlembicConfig()
    config.set_main_option("script_location", str(MIGRATIONS))
    return config


def _check_encoding(connection: Connection) -> None:
    encoding = connection.scalar(text("SHOW server_encoding"))
    if encoding != "UTF8":
        raise InvalidInputError(
            f"database: it has the encoding {encoding}, expected UTF8: make one by createdb --template template0"
            " --encoding UTF8"
        )


def _check_revision(connection: Connection, scripts: ScriptDirectory) -> set[str]:
    """Revision of the tables; empty: there are none."""
    known = {script.revision for script in scripts.walk_revisions()}
    there = set(MigrationContext.configure(connection).get_current_heads())
    for found in there:
        if found not in known:
            raise InvalidInputError(
                f"database: its tables have revision '{found}', expected {' or '.join(sorted(known))}: another version"
                " of dohyo made them; serve them with that version, or choose a new --data folder or --database"
            )
    return there


def _make_engine(url: str, busy_s: float, pool: int) -> Engine:
    try:
        parsed = make_url(url)
        if (kind := parsed.get_backend_name()) not in ("sqlite", "postgresql", "postgres"):
            raise InvalidInputError(f"database: expected sqlite or postgresql, got '{kind}'")
        return _make_sqlite(parsed, busy_s, pool) if kind == "sqlite" else _make_postgresql(parsed, busy_s, pool)
    except (ArgumentError, ValueError, ImportError) as error:
        # The URL may hold a password: it is not repeated.
        raise InvalidInputError(
            "database: expected a URL such as postgresql://user:password@host:5432/name or sqlite:////srv/dohyo.db"
        ) from error


def _make_sqlite(url: URL, busy_s: float, pool: int) -> Engine:
    if url.database in (None, "", ":memory:") or "uri" in url.query:
        raise InvalidInputError("database: expected a file of SQLite, such as sqlite:////srv/dohyo.db")
    if url.drivername not in ("sqlite", "sqlite+pysqlite"):
        raise InvalidInputError(f"database: expected sqlite or postgresql, got '{url.drivername}'")
    engine = create_engine(url, connect_args={"timeout": busy_s, "check_same_thread": False}, pool_size=pool)
    event.listen(engine, "connect", partial(_configure_sqlite, busy_s=busy_s))
    event.listen(engine, "begin", _begin_sqlite)
    return engine


def _make_postgresql(url: URL, busy_s: float, pool: int) -> Engine:
    milliseconds = int(busy_s * 1000)
    options = f"-c lock_timeout={milliseconds} -c statement_timeout={milliseconds * 6} -c timezone=UTC"
    return create_engine(
        url.set(drivername="postgresql+psycopg"),
        connect_args={**surviving(options), "connect_timeout": max(2, int(busy_s))},
        pool_size=pool,
        max_overflow=pool,
        pool_timeout=busy_s,
        pool_pre_ping=True,
    )


def _configure_sqlite(connection: sqlite3.Connection, _record: object, *, busy_s: float) -> None:
    # The driver would begin transactions by itself, and only before the first write.
    connection.isolation_level = None
    cursor = connection.cursor()
    _enter_wal_mode(cursor, busy_s)
    for pragma in ("synchronous=NORMAL", "foreign_keys=ON"):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()


def _enter_wal_mode(cursor: sqlite3.Cursor, busy_s: float) -> None:
    """Sets the journal mode of a new file; SQLite refuses at once where another process is doing the same."""
    deadline = time.monotonic() + busy_s
    while True:
        try:
            cursor.execute("PRAGMA journal_mode=WAL")
            return
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF != sqlite3.SQLITE_BUSY or time.monotonic() >= deadline:
                raise
            time.sleep(WAL_RETRY_S)


def _begin_sqlite(connection: Connection) -> None:
    write = connection.get_execution_options().get("dohyo_write", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if write else "BEGIN")
