"""`dohyo tokens` beside a server: it changes no table under it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from alembic import command as alembic
from alembic.config import Config

from dohyo.service.database.engine import MIGRATIONS, Database
from dohyo.service.database.server_lock import ServerLock
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service.serving import command
from tests.service.tables import sqlite_with_tables


@pytest.fixture
def earlier(tmp_path: Path) -> Iterator[Database]:
    """The database of a data folder, with the tables of an earlier version."""
    database = Database(sqlite_with_tables(tmp_path / "dohyo.db"))
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    with database.engine.begin() as connection:
        config.attributes["connection"] = connection
        alembic.downgrade(config, "-1")
    yield database
    database.close()


def test_the_tables_of_a_running_server_are_not_migrated(earlier: Database, tmp_path: Path) -> None:
    assert not earlier.is_migrated()
    server = ServerLock(earlier, lost=lambda: None)
    server.take()
    for order in (("list",), ("create", "--owner", "team"), ("revoke", "tok-1")):
        refused = command("tokens", *order, "--data", str(tmp_path)).exception
        assert isinstance(refused, InvalidInputError)
        assert "another server uses it" in str(refused)
    assert not earlier.is_migrated()
    server.release()
    assert command("tokens", "create", "--owner", "team", "--data", str(tmp_path)).exit_code == 0
    assert earlier.is_migrated()


def test_a_server_of_this_version_does_not_disturb(tmp_path: Path) -> None:
    database = Database(sqlite_with_tables(tmp_path / "dohyo.db"))
    server = ServerLock(database, lost=lambda: None)
    server.take()
    assert command("tokens", "create", "--owner", "team", "--data", str(tmp_path)).exit_code == 0
    assert "team" in command("tokens", "list", "--data", str(tmp_path)).stdout
    server.release()
    database.close()
