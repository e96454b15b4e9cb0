"""`dohyo database move`: a stopped service goes on with another database."""

from __future__ import annotations

import secrets
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select, text

from dohyo.service.database.base import now
from dohyo.service.database.engine import Database
from dohyo.service.database.identity import FILE, claim
from dohyo.service.database.moving import move
from dohyo.service.database.server_lock import Server, server_lock
from dohyo.service.database.tables import METADATA
from dohyo.service.evaluations.model import Episode
from dohyo.service.jobs.model import Job, JobStatus
from dohyo.service.worlds.model import World, WorldStatus
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service.harness import Caller, Harness, running
from tests.service.postgres import fresh_database
from tests.service.serving import command
from tests.service.tables import sqlite_with_tables

MANY = 1234


def fill(service: Harness) -> Caller:
    """Rows of most tables, of which more than are copied at once; returns whose they are."""
    team = service.caller("team")
    team.agent("kept", limit=5.5)
    evaluation = team.evaluation("kept")
    ended = {"status": WorldStatus.DONE, "finished": now(), "record_hash": "0" * 64, "kept_bytes": 2**30}
    with service.services.database.session() as session:
        session.add_all(Server(host=f"host-{number}", process=number) for number in range(MANY))
        session.add(World(id="wo-kept", owner="team", order={"network": "ingolstadt", "ä": [None, 1.5]}, **ended))
        session.add(Job(id="job-null", kind="import", owner="team", arguments={}, status=JobStatus.FAILED))
        episode = session.scalars(select(Episode).where(Episode.evaluation_id == evaluation)).first()
        assert episode is not None
        episode.summary = {"driving_score": 61.25}
    claim(service.services.settings.data, service.services.database)
    return team


def rows(database: Database) -> dict[str, list[Any]]:
    with database.reading() as session:
        return {
            table.name: sorted(tuple(map(repr, row)) for row in session.execute(select(table)))
            for table in METADATA.sorted_tables
            if table.name != "identity"
        }


@pytest.fixture
def empty(postgres_server: str) -> str:
    return fresh_database(postgres_server, f"to_{secrets.token_hex(6)}")


def stopped(data: Path) -> Caller:
    with running(data) as service:
        return fill(service)


def test_a_service_goes_on_in_postgresql_and_comes_back(tmp_path: Path, empty: str) -> None:
    data, back = tmp_path / "data", tmp_path / "back.db"
    team = stopped(data)
    first = Database(f"sqlite:///{data / 'dohyo.db'}")
    before, identity = rows(first), (data / FILE).read_text()
    answer = command("database", "move", "--data", str(data), "--to", empty)
    assert answer.exit_code == 0, answer.output
    assert f"moved {sum(map(len, before.values())):,} rows" in answer.output.replace("\n", " ")
    second = Database(empty)
    assert rows(second) == before
    assert (data / FILE).read_text() != identity
    with second.reading() as session:
        assert session.scalar(text("SELECT count(*) FROM jobs WHERE answer IS NULL")) == 1
    second.close()

    with running(data, database=empty) as service:
        again = Caller(service.client, team.headers["authorization"].removeprefix("Bearer "))
        assert [one["agent"] for one in again.get("/v1/evaluations").json()["items"]] == ["kept"]
        again.evaluation("kept")
        with service.services.database.session() as session:
            newest = Server(host="next", process=1)
            session.add(newest)
            session.flush()
            assert newest.id > MANY

    between = Database(empty)
    changed = rows(between)
    answer = command("database", "move", "--data", str(data), "--database", empty, "--to", f"sqlite:///{back}")
    assert answer.exit_code == 0, answer.output
    assert rows(between) == changed
    last = Database(f"sqlite:///{back}")
    assert rows(last) == changed
    for database in (first, between, last):
        database.close()


def test_the_folder_refuses_the_database_that_it_had(tmp_path: Path, empty: str) -> None:
    data = tmp_path / "data"
    stopped(data)
    assert command("database", "move", "--data", str(data), "--to", empty).exit_code == 0
    old = command("tokens", "list", "--data", str(data)).exception
    assert isinstance(old, InvalidInputError)
    assert "belongs to database postgresql-" in str(old)
    assert command("tokens", "list", "--data", str(data), "--database", empty).exit_code == 0


def test_what_is_refused_changes_nothing(tmp_path: Path, empty: str) -> None:
    data = tmp_path / "data"
    stopped(data)
    other = sqlite_with_tables(tmp_path / "other.db")
    source, target = Database(f"sqlite:///{data / 'dohyo.db'}"), Database(empty)
    before, identity = rows(source), (data / FILE).read_text()

    def refused(*arguments: str) -> str:
        error = command("database", "move", *arguments).exception
        assert isinstance(error, InvalidInputError), error
        assert (data / FILE).read_text() == identity
        return str(error)

    assert "the same" in refused("--data", str(data), "--to", f"sqlite:///{data / 'dohyo.db'}")
    for present in ((), ("--database", other)):
        assert "holds no data" in refused("--data", str(tmp_path / "nothing"), *present, "--to", empty)
    assert "belongs to database" in refused("--data", str(data), "--database", other, "--to", empty)
    assert "expected sqlite or postgresql" in refused("--data", str(data), "--to", "mysql://localhost/x")
    target.migrate()
    with server_lock(source):
        assert "another server uses it" in refused("--data", str(data), "--to", empty)
    with target.session() as session:
        session.add(Server(host="taken", process=1))
    assert "expected an empty database, and its table 'servers' has 1 rows" in refused(
        "--data", str(data), "--to", empty
    )
    assert rows(source) == before
    source.close()
    target.close()


def test_a_row_that_cannot_be_stored_moves_nothing(tmp_path: Path, empty: str) -> None:
    """SQLite stores a text of any length and with any character; PostgreSQL does not."""
    data = tmp_path / "data"
    stopped(data)
    source, target = Database(f"sqlite:///{data / 'dohyo.db'}"), Database(empty)
    with source.session() as session:
        session.execute(text("UPDATE worlds SET owner = :long"), {"long": "x" * 101})
    with pytest.raises(InvalidInputError, match="too long"):
        move(data, source, target)
    assert not any(rows(target).values())
    source.close()
    target.close()
