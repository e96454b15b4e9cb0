"""Identity: to which database a data folder belongs.

Files of the folder are named by rows of one database. A service with another one would start empty, and would delete
files that the first one still names.
"""

from __future__ import annotations

import os
import secrets
from pathlib import Path
from typing import Final

from sqlalchemy import Connection, String, func, inspect, select
from sqlalchemy.orm import Mapped, mapped_column

from dohyo.service.accounts.model import Token
from dohyo.service.database.base import Base
from dohyo.service.database.engine import Database
from dohyo.sumo_networks.errors import InvalidInputError

FILE: Final = "database-id"
SQLITE: Final = "dohyo.db"
WAYS: Final = (
    "name its own one by --database or DOHYO_DATABASE (without them: dohyo.db in the folder), or another --data folder"
)


class Identity(Base):
    """The only row is the identity of this database, such as "sqlite-9f86d081884c7d65", which also its copies have."""

    __tablename__ = "identity"

    id: Mapped[str] = mapped_column(String(32), primary_key=True)


def check_identity(data: Path, database: Database) -> None:
    """Refuses a database to which a data folder does not belong; makes nothing, not even a file of SQLite.

    Args:
        data: The folder; one without an identity belongs to any database.
        database: Perhaps without tables.

    Raises:
        InvalidInputError: The folder belongs to another database.
        SQLAlchemyError: The database cannot be read.
    """
    there = _written(data)
    if there is not None and there != (here := _read(database)[0]):
        raise InvalidInputError(
            f"data folder '{data}' belongs to database {there}, and this is {here or 'another one'}: {WAYS}; if both"
            f" were restored from a backup, delete '{data / FILE}'"
        )


def check_served(data: Path) -> None:
    """Refuses a folder from which nothing was served: a command that opens its database would make an empty one.

    Raises:
        InvalidInputError: It has neither an identity nor a file of SQLite.
    """
    if not any((data / name).is_file() for name in (FILE, SQLITE)):
        raise InvalidInputError(f"'{data}' holds no data of a service; `dohyo serve --data` creates it")


def check_folder(data: Path, records: Path, database: Database) -> None:
    """The same before a service starts, which also needs a database that can name the records in the folder.

    Args:
        data: The folder.
        records: Folder of its records.
        database: Perhaps without tables.

    Raises:
        InvalidInputError: The folder belongs to another database, or has records, while the database was never served.
        SQLAlchemyError: The database cannot be read.
    """
    check_identity(data, database)
    if _written(data) is None and not _read(database)[1] and next(records.rglob("*.*"), None) is not None:
        raise InvalidInputError(f"data folder '{data}' has records, and this database is empty: {WAYS}")


def claim(data: Path, database: Database) -> None:
    """Lets a data folder belong to a database with tables, which gets an identity if it has none.

    Raises:
        OSError: The folder cannot be written to.
    """
    with database.session() as session:
        own = session.scalar(select(Identity.id))
        if own is None:
            own = f"{'sqlite' if database.is_sqlite else 'postgresql'}-{secrets.token_hex(8)}"
            session.add(Identity(id=own))
    if _written(data) != own:
        new = data / f"{FILE}.new"
        new.write_text(f"{own}\n")
        os.replace(new, data / FILE)


def _written(data: Path) -> str | None:
    """The identity in a data folder."""
    try:
        return (data / FILE).read_text(errors="replace").strip() or None
    except FileNotFoundError:
        return None


def _read(database: Database) -> tuple[str | None, bool]:
    """The identity of a database, and whether it has a token, as after its first start."""
    if database.is_sqlite and not Path(database.engine.url.database or "").exists():
        return None, False
    with database.engine.connect() as connection:
        own = connection.scalar(select(Identity.id)) if _has(connection, Identity) else None
        tokens = connection.scalar(select(func.count()).select_from(Token)) if _has(connection, Token) else 0
        return own, bool(tokens)


def _has(connection: Connection, table: type[Base]) -> bool:
    return inspect(connection).has_table(table.__tablename__)
