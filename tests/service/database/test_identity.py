"""A data folder belongs to one database: `dohyo serve` and `dohyo tokens` refuse any other."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from dohyo.service.accounts.queries import first_admin_token
from dohyo.service.database.engine import Database
from dohyo.service.database.identity import FILE, check_folder, check_identity, claim
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service.serving import command
from tests.service.tables import postgresql_with_tables, sqlite_with_tables


class Folder:
    """A data folder with a record, and two databases."""

    def __init__(self, data: Path, server: str) -> None:
        self.data, self.records = data, data / "records"
        (self.records / "ab").mkdir(parents=True)
        (self.records / "ab" / "abcd.json").write_text("{}")
        self.elsewhere = postgresql_with_tables(server)
        self.sqlite = Database(sqlite_with_tables(data / "dohyo.db"))
        self.postgresql = Database(self.elsewhere)

    def serve(self, database: Database) -> None:
        """Its first start."""
        with database.session() as session:
            first_admin_token(session)
        claim(self.data, database)

    def check(self, database: Database) -> None:
        check_folder(self.data, self.records, database)


@pytest.fixture
def folder(tmp_path: Path, postgres_server: str) -> Iterator[Folder]:
    made = Folder(tmp_path / "data", postgres_server)
    yield made
    made.sqlite.close()
    made.postgresql.close()


def refusal(*arguments: str) -> str:
    """What a command says that refuses its folder, in one line."""
    error = command(*arguments).exception
    assert isinstance(error, InvalidInputError), error
    assert "\n" not in str(error)
    return str(error)


def test_a_folder_belongs_to_its_database_alone(folder: Folder) -> None:
    """Before, the other one began empty, and deletions there removed files that the first one needs."""
    folder.serve(folder.sqlite)
    folder.check(folder.sqlite)
    claim(folder.data, folder.sqlite)
    folder.check(folder.sqlite)
    serve = ("serve", "--port", "0", "--data", str(folder.data))
    said = refusal(*serve, "--database", folder.elsewhere)
    assert "belongs to database sqlite-" in said
    assert "and this is another one: name its own one by --database or DOHYO_DATABASE" in said
    with pytest.raises(InvalidInputError, match="belongs to database sqlite-"):
        folder.check(folder.postgresql)


def test_a_forgotten_database_is_noticed(folder: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    folder.serve(folder.postgresql)
    folder.sqlite.close()
    serve = ("serve", "--port", "0", "--data", str(folder.data))
    assert "belongs to database postgresql-" in refusal(*serve)
    (folder.data / "dohyo.db").unlink()
    assert "belongs to database postgresql-" in refusal(*serve)
    assert not (folder.data / "dohyo.db").exists()
    monkeypatch.setenv("DOHYO_DATABASE", folder.elsewhere)
    assert command("tokens", "list", "--data", str(folder.data)).exit_code == 0


@pytest.mark.parametrize("there", [True, False])
def test_tokens_are_not_made_in_another_database(folder: Folder, there: bool) -> None:
    """Before, they were made in a database that the service does not use, and were refused by it."""
    folder.serve(folder.postgresql)
    folder.sqlite.close()
    if not there:
        (folder.data / "dohyo.db").unlink()
    data = ("--data", str(folder.data))
    for order in (("create", "--owner", "team"), ("list",), ("revoke", "tok-1")):
        said = refusal("tokens", *order, *data)
        assert "belongs to database postgresql-" in said
        assert "--database" in said
    made = command("tokens", "create", "--owner", "team", *data, "--database", folder.elsewhere)
    assert made.exit_code == 0, made.exception
    assert "team" in command("tokens", "list", *data, "--database", folder.elsewhere).stdout
    assert (folder.data / "dohyo.db").exists() is there


def test_a_named_database_needs_no_folder(folder: Folder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where none is named, another service's folder of the default name may lie in the working directory."""
    claim(folder.data, folder.sqlite)
    folder.sqlite.close()
    folder.data.rename(tmp_path / "dohyo-data")
    monkeypatch.chdir(tmp_path)
    assert command("tokens", "list", "--database", folder.elsewhere).exit_code == 0


def test_a_folder_of_before_takes_the_identity_of_its_database(folder: Folder) -> None:
    folder.serve(folder.sqlite)
    (folder.data / FILE).unlink()
    folder.check(folder.sqlite)
    with pytest.raises(InvalidInputError, match="has records, and this database is empty: name its own one"):
        folder.check(folder.postgresql)
    with pytest.raises(InvalidInputError, match="has records"):
        check_folder(folder.data, folder.records, Database(f"sqlite:///{folder.data / 'none.db'}"))
    assert not (folder.data / "none.db").exists()
    (folder.records / "ab" / "abcd.json").unlink()
    folder.check(folder.postgresql)


def test_each_database_has_one_identity_for_ever(database: Database, tmp_path: Path) -> None:
    written = []
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        claim(tmp_path / name, database)
        written.append((tmp_path / name / FILE).read_text())
        check_identity(tmp_path / name, database)
    assert written[0] == written[1]
    assert written[0].split("-")[0] == ("sqlite" if database.is_sqlite else "postgresql")
