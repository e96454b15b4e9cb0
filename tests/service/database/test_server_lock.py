"""One server per database: two real servers on each kind of database, and servers that lose their lock."""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator
from pathlib import Path

import psycopg
import pytest
from sqlalchemy import text

from dohyo.service.accounts.model import Role
from dohyo.service.accounts.queries import create_token
from dohyo.service.database.engine import Database, FencedError
from dohyo.service.database.server_lock import APPLICATION
from tests.service.postgres import fresh_database
from tests.service.served import wait_until
from tests.service.serving import Served, run, serving

TERMINATE = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE application_name = %s"
HELD = "SELECT (classid::bigint << 32) | objid::bigint FROM pg_locks WHERE locktype = 'advisory'"
LOCK = f"SELECT pg_advisory_lock(({HELD}))"


@pytest.fixture
def first(tmp_path: Path, database_url: str) -> Iterator[Served]:
    with serving(tmp_path / "first", "--database", database_url) as served:
        yield served


@pytest.mark.slow
def test_a_second_server_is_refused_and_the_first_goes_on(first: Served, tmp_path: Path, database_url: str) -> None:
    second = run("serve", "--port", "0", "--data", str(tmp_path / "second"), "--database", database_url)
    assert second.returncode not in (0, None)
    (line,) = [line for line in second.stderr.splitlines() if "another server" in line]
    assert f"process {first.process.pid}" in line
    assert "expected one server per database" in line
    assert "Traceback" not in second.stderr
    first.ask("POST", "/v1/agents", {"name": "a"})
    first.process.kill()
    first.process.wait()
    with serving(tmp_path / "second", "--database", database_url) as after_a_kill:
        assert after_a_kill.end() == 0


@pytest.mark.slow
def test_a_server_whose_connection_breaks_goes_on_with_the_lock_and_ends_where_another_has_it(
    tmp_path: Path, postgres_server: str
) -> None:
    url = fresh_database(postgres_server, "taken")
    with serving(tmp_path / "data", "--database", url) as served:
        with psycopg.connect(url, autocommit=True) as waiting, psycopg.connect(url, autocommit=True) as other:
            assert other.execute(TERMINATE, [APPLICATION]).fetchall() == [(True,)]
            wait_until(lambda: any("held again" in one["message"] for one in served.log), "it takes no lock again")
            served.ask("POST", "/v1/agents", {"name": "a"})
            # The other server waits for the lock, and gets it when the connection of the first one breaks.
            with waiting.pipeline():
                waiting.execute(LOCK)
                wait_until(lambda: _waits(other), "the other server does not wait")
                other.execute(TERMINATE, [APPLICATION])
            assert served.process.wait(120) == 3
        assert "another server has taken the database" in served.log[-1]["message"]
        assert url not in json.dumps(served.log)
    assert not (tmp_path / "data" / "dohyo.db").exists()


def _waits(connection: psycopg.Connection) -> bool:  # type: ignore[type-arg]
    row = connection.execute("SELECT count(*) FROM pg_locks WHERE locktype = 'advisory' AND NOT granted").fetchone()
    return row == (1,)


@pytest.mark.slow
def test_a_server_whose_lock_file_was_replaced_ends_at_once(tmp_path: Path) -> None:
    file = tmp_path / "shared.db"
    with serving(tmp_path / "data", "--database", f"sqlite:///{file}") as served:
        other = tmp_path / "other.lock"
        with other.open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            other.replace(f"{file}.lock")  # at once, or the server would make its own anew
            assert served.process.wait(120) == 3
        assert "another server has taken the database" in served.log[-1]["message"]


def test_what_is_fenced_writes_nothing(database: Database) -> None:
    database.fenced = True
    with pytest.raises(FencedError), database.session():
        pytest.fail("it was let in")
    database.fenced = False

    def lose_it_meanwhile() -> None:
        with database.session() as session:
            create_token(session, "team", Role.READER)
            database.fenced = True

    with pytest.raises(FencedError):
        lose_it_meanwhile()
    with database.reading() as session:
        assert session.scalar(text("SELECT count(*) FROM tokens")) == 0
