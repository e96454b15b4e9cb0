"""Moves a service from one database into another, such as from SQLite to PostgreSQL.

Files of the data folder stay where they are. The folder belongs to the new database from then on, and the old one,
which keeps its rows, is refused.
"""

from __future__ import annotations

from pathlib import Path

from sqlalchemy import JSON, Connection, MetaData, Table, func, insert, select, text
from sqlalchemy.orm import Session

from dohyo.service.database.engine import Database, usable
from dohyo.service.database.identity import Identity, check_identity, check_served, claim
from dohyo.service.database.server_lock import server_lock
from dohyo.service.database.tables import METADATA
from dohyo.sumo_networks.errors import InvalidInputError

_BATCH = 500


def move(data: Path, source: Database, target: Database) -> dict[str, int]:
    """Copies all rows into an empty database, to which the data folder then belongs.

    Either all rows are there afterwards, or none is and the folder still belongs to the first database.

    Args:
        data: Folder of the service's data.
        source: Its database, which no server may use meanwhile.
        target: Another database, without tables or with empty ones.

    Returns:
        Number of rows by table.

    Raises:
        InvalidInputError: Nothing was served from the folder, it belongs to another database than `source`, a server
            uses one of the two, the tables are of another version, `target` has rows, or it cannot store a row.
    """
    if source.engine.url == target.engine.url:
        raise InvalidInputError("--to: expected another database than the present one, got the same")
    check_served(data)
    with usable():
        check_identity(data, source)
    with server_lock(source), server_lock(target):
        with usable(), source.reading() as old, target.session() as new:
            _check_empty(new)
            moved = {table.name: _copy(table, old, new.connection()) for table in _moved_tables()}
            if not target.is_sqlite:
                _continue_numbers(new.connection())
        claim(data, target)
    return moved


def _moved_tables() -> list[Table]:
    """All tables but the identity's, in the order of their keys, with NULL as it is instead of JSON's null."""
    copies = MetaData()
    for table in METADATA.sorted_tables:
        for column in table.to_metadata(copies).columns:
            if isinstance(column.type, JSON):
                column.type = JSON(none_as_null=True)
    return [table for table in copies.sorted_tables if table.name != Identity.__tablename__]


def _check_empty(session: Session) -> None:
    for table in METADATA.sorted_tables:
        if rows := session.scalar(select(func.count()).select_from(table)):
            raise InvalidInputError(
                f"--to: expected an empty database, and its table '{table.name}' has {rows:,} rows: make a new one"
            )


def _copy(table: Table, old: Session, new: Connection) -> int:
    rows = 0
    for batch in old.execute(select(table).execution_options(yield_per=_BATCH)).mappings().partitions():
        new.execute(insert(table), [dict(row) for row in batch])
        rows += len(batch)
    return rows


def _continue_numbers(connection: Connection) -> None:
    """Lets PostgreSQL number new rows after the copied ones."""
    for table in METADATA.sorted_tables:
        column = table.autoincrement_column
        if column is None:
            continue
        highest = connection.scalar(select(func.max(column)))
        if highest is not None:
            sequence = {"table": table.name, "column": column.name, "highest": highest}
            connection.execute(text("SELECT setval(pg_get_serial_sequence(:table, :column), :highest)"), sequence)
