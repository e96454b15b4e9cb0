"""Databases that have their tables already: copies of one that was migrated, since a migration outlasts most tests."""

from __future__ import annotations

import secrets
import tempfile
from functools import cache
from pathlib import Path

from dohyo.service.database.engine import Database
from tests.service.postgres import fresh_database


def sqlite_with_tables(path: Path) -> str:
    """The URL of a new SQLite file, with all tables and no row."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(_migrated_file())
    return f"sqlite:///{path}"


def postgresql_with_tables(server: str) -> str:
    """The URL of a new database of a PostgreSQL server, with all tables and no row."""
    return fresh_database(server, f"test_{secrets.token_hex(6)}", like=_migrated_database(server))


@cache
def _migrated_file() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "dohyo.db"
        _migrate(f"sqlite:///{file}")
        return file.read_bytes()


@cache
def _migrated_database(server: str) -> str:
    name = "migrated"
    _migrate(fresh_database(server, name))
    return name


def _migrate(url: str) -> None:
    database = Database(url)
    database.migrate()
    database.close()
