from __future__ import annotations

import multiprocessing
import sqlite3
import threading
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from sqlalchemy import inspect, select, text
from sqlalchemy.exc import IntegrityError, OperationalError
from sqlalchemy.orm import Session

from dohyo.service.accounts.model import Role, Token
from dohyo.service.accounts.queries import create_token
from dohyo.service.boards.model import Ranking, Result
from dohyo.service.database.base import Base
from dohyo.service.database.engine import MIGRATIONS, Database
from dohyo.service.database.server_lock import server_lock
from dohyo.service.evaluations.model import BenchmarkVersion, Episode, EpisodeStatus, Evaluation
from dohyo.service.evaluations.versions import EARLIER
from dohyo.service.submissions.model import Agent, Submission
from dohyo.service.worlds.model import World
from dohyo.service.worlds.queries import add_guest, list_guests
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service import postgres


def test_the_migrations_make_exactly_what_the_models_say(database: Database) -> None:
    with database.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True, "compare_server_default": True})
        assert compare_metadata(context, Base.metadata) == []


def test_a_missing_column_would_be_noticed(database: Database) -> None:
    """The test above can fail."""
    with database.engine.begin() as connection:
        connection.execute(text("ALTER TABLE agents DROP COLUMN description"))
    with database.engine.connect() as connection:
        (difference,) = compare_metadata(MigrationContext.configure(connection), Base.metadata)
        assert difference[0] == "add_column"


def test_migrating_again_changes_nothing(database: Database) -> None:
    with database.session() as session:
        create_token(session, "team", Role.READER)
    database.migrate()
    with database.reading() as session:
        assert session.scalars(select(Token.owner)).all() == ["team"]


def test_tables_of_another_version_are_refused_and_stay_as_they_are(database: Database) -> None:
    with database.engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '0001'"))
        connection.execute(text("ALTER TABLE agents DROP COLUMN description"))
    with pytest.raises(
        InvalidInputError,
        match=r"revision '0001', expected 2026_11 or 2026_11_board_indexes or 2026_11_creation_index or ",
    ):
        database.migrate()
    assert "description" not in [one["name"] for one in inspect(database.engine).get_columns("agents")]


def test_migrations_can_be_taken_back(database: Database) -> None:
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    with database.engine.begin() as connection:
        config.attributes["connection"] = connection
        command.downgrade(config, "base")
    assert inspect(database.engine).get_table_names() == ["alembic_version"]


def _add_evaluation(session: Session, name: str, episodes: EpisodeStatus) -> None:
    rest: dict[str, Any] = {"owner": "o", "submission_id": "s", "benchmark_sha256": "b", "act_deadline_s": 1.0}
    session.add(Evaluation(id=name, seeds=[0], **rest))
    session.flush()
    session.add(Episode(id=name, evaluation_id=name, position=0, scenario="s", cell="c", seed=0, status=episodes))


def test_evaluations_of_before_were_driven_by_an_earlier_version_if_at_all(database: Database) -> None:
    with database.session() as session:
        session.add_all([Agent(id="a", name="a", owner="o"), BenchmarkVersion(sha256="b", name="b", document={})])
        session.flush()
        session.add(Submission(id="s", agent_id="a", version=1, kind="builtin", track="map", info={}))
        session.flush()
        _add_evaluation(session, "driven", EpisodeStatus.DONE)
        _add_evaluation(session, "waiting", EpisodeStatus.QUEUED)
    _downgrade(database, "2026_11_creation_index")
    assert "dohyo_versions" not in [one["name"] for one in inspect(database.engine).get_columns("evaluations")]
    database.migrate()
    with database.reading() as session:
        found = session.execute(select(Evaluation.id, Evaluation.dohyo_versions).order_by(Evaluation.id))
        assert [tuple(row) for row in found] == [("driven", [EARLIER]), ("waiting", [])]


def test_numbers_of_evaluations_of_before_follow_their_times(database: Database) -> None:
    began = datetime.now(UTC)
    with database.session() as session:
        session.add_all([Agent(id="a", name="a", owner="o"), BenchmarkVersion(sha256="b", name="b", document={})])
        session.flush()
        session.add(Submission(id="s", agent_id="a", version=1, kind="builtin", track="map", info={}))
        session.flush()
        for name, minutes in (("third", 3), ("first", 1), ("second", 2)):
            _add_evaluation(session, name, EpisodeStatus.QUEUED)
            session.get_one(Evaluation, name).created = began + timedelta(minutes=minutes)
        numbers = {one.id: one.number for one in session.scalars(select(Evaluation)).unique()}
    assert numbers == {"third": 1, "first": 2, "second": 3}
    _downgrade(database, "2026_14_admission_of_guests")
    database.migrate()
    with database.session() as session:
        _add_evaluation(session, "later", EpisodeStatus.QUEUED)
    with database.reading() as session:
        ordered = session.scalars(select(Evaluation.id).order_by(Evaluation.number))
        assert ordered.all() == ["first", "second", "third", "later"]


@pytest.mark.parametrize("dropped", [False, True])
def test_results_lose_the_time_of_their_order_once(dropped: bool, database: Database) -> None:
    """An earlier migration dropped it for a few hours."""
    _downgrade(database, "2026_16_identity")
    if dropped:
        with database.engine.begin() as connection:
            connection.execute(text("ALTER TABLE results DROP COLUMN ordered"))
    database.migrate()
    assert "ordered" not in {column["name"] for column in inspect(database.engine).get_columns("results")}


def test_results_of_before_are_computed_again(database: Database) -> None:
    """They held a value per ego, and egos of one episode are no independent drives."""
    with database.session() as session:
        session.add_all([Agent(id="a", name="a", owner="o"), BenchmarkVersion(sha256="b", name="b", document={})])
        session.flush()
        session.add(Submission(id="s", agent_id="a", version=1, kind="builtin", track="map", info={}))
        rules = {"act_deadline_s": 10.0, "runs_per_period": 1, "period_s": 60.0}
        session.add(Ranking(id="r", benchmark_sha256="b", seeds=[0], **rules))
        session.flush()
        _add_evaluation(session, "e", EpisodeStatus.DONE)
    _downgrade(database, "2026_12_dohyo_versions")
    with database.session() as session:
        facts = {"values": [1.0, 2.0]}
        now = datetime.now(UTC)
        kept = {"entrant": "s", "track": "map", "score": 1.0, "finished": now, "facts": facts}
        session.add(Result(evaluation_id="e", ranking_id="r", **kept))
    database.migrate()
    with database.reading() as session:
        assert session.scalars(select(Result)).all() == []


def test_guests_of_before_have_no_time_of_admission(database: Database) -> None:
    _downgrade(database, "2026_13_values_of_episodes")
    assert "admitted" not in [one["name"] for one in inspect(database.engine).get_columns("world_guests")]
    with database.engine.begin() as connection:
        connection.execute(text("INSERT INTO world_guests (world_id, owner) VALUES ('wo-1', 'guest')"))
    database.migrate()
    with database.session() as session:
        add_guest(session, "wo-1", "guest")
        add_guest(session, "wo-1", "late")
    with database.reading() as session:
        found = {guest.owner: guest.admitted is not None for guest in list_guests(session, "wo-1", 10, None)}
        assert found == {"guest": False, "late": True}


def test_sizes_of_worlds_of_before_stay_and_larger_ones_have_room(database: Database) -> None:
    """Before, PostgreSQL had 32 bits for them."""
    with database.session() as session:
        session.add(World(id="wo-1", owner="o", order={}, kept_bytes=7))
    _downgrade(database, "2026_17_orders_of_results")
    database.migrate()
    with database.session() as session:
        session.add(World(id="wo-2", owner="o", order={}, kept_bytes=3_000_000_000))
    with database.reading() as session:
        assert session.scalars(select(World.kept_bytes).order_by(World.id)).all() == [7, 3_000_000_000]


def _downgrade(database: Database, revision: str) -> None:
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    with database.engine.begin() as connection:
        config.attributes["connection"] = connection
        command.downgrade(config, revision)


def _migrate(url: str, start: object) -> None:
    start.wait(300)  # type: ignore[attr-defined]
    database = Database(url, busy_s=120.0)
    database.migrate()
    database.close()


def test_services_that_start_at_once_do_not_race(empty_database_url: str) -> None:
    spawn = multiprocessing.get_context("spawn")
    start = spawn.Barrier(3)
    children = [spawn.Process(target=_migrate, args=(empty_database_url, start), daemon=True) for _ in range(3)]
    for child in children:
        child.start()
    for child in children:
        child.join(300)
    assert [child.exitcode for child in children] == [0, 0, 0]
    database = Database(empty_database_url)
    with database.reading() as session:
        found = session.scalars(text("SELECT version_num FROM alembic_version")).all()  # type: ignore[call-overload]
        assert found == ["2026_18_unannounced_ends"]
    database.close()


def test_the_first_connection_waits_for_another_that_holds_the_lock_of_a_new_file(tmp_path: Path) -> None:
    """SQLite itself refuses to change the journal mode at once, without its busy timeout."""
    url = f"sqlite:///{tmp_path / 'd.db'}"
    other = sqlite3.connect(tmp_path / "d.db", isolation_level=None, check_same_thread=False)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(OperationalError, match="locked"):
        Database(url, busy_s=0.1).check()
    database = Database(url, busy_s=30.0)
    release = threading.Timer(0.3, other.rollback)
    release.start()
    database.check()
    release.join()
    database.close()
    other.close()


def test_what_raises_leaves_nothing_behind(database: Database) -> None:
    def fail() -> None:
        with database.session() as session:
            create_token(session, "team", Role.READER)
            raise RuntimeError("late")

    with pytest.raises(RuntimeError):
        fail()
    with database.reading() as session:
        assert session.scalars(select(Token)).all() == []


def test_readers_do_not_wait_for_a_writer(database: Database) -> None:
    with database.session() as writing:
        create_token(writing, "team", Role.READER)
        with database.reading() as session:  # one that waits fails after busy_s
            assert session.scalars(select(Token)).all() == []


def test_writers_on_sqlite_wait_for_each_other_and_none_is_lost(tmp_path: Path) -> None:
    database = Database(f"sqlite:///{tmp_path / 'd.db'}", busy_s=20.0)
    database.migrate()

    def count_up() -> None:
        for _ in range(10):
            with database.session() as session:
                # Reads before it writes: with SQLite's own transactions this fails or loses counts.
                seen = len(session.scalars(select(Token)).all())
                session.add(Token(id=f"tok-{seen}", owner="o", role=Role.READER, sha256=f"{seen:064d}"))

    threads = [threading.Thread(target=count_up) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    with database.reading() as session:
        assert sorted(session.scalars(select(Token.id))) == sorted(f"tok-{i}" for i in range(40))
    database.close()


def test_a_writer_gives_up_when_another_holds_the_lock(tmp_path: Path) -> None:
    database = Database(f"sqlite:///{tmp_path / 'd.db'}", busy_s=0.2)
    database.migrate()
    with database.session() as first:
        create_token(first, "team", Role.READER)
        with pytest.raises(OperationalError, match="locked"), database.session() as second:
            create_token(second, "team", Role.READER)
    database.close()


def test_foreign_keys_hold(database: Database) -> None:
    orphan = Submission(id="s", agent_id="none", version=1, kind="builtin", track="map", info={})
    with pytest.raises(IntegrityError), database.session() as session:
        session.add(orphan)


def test_moments_come_back_with_their_zone(database: Database) -> None:
    with database.session() as session:
        session.add(Agent(id="a", name="a", owner="o", description=""))
    with database.reading() as session:
        (created,) = session.scalars(select(Agent.created)).all()
    assert created.utcoffset() is not None
    assert created.utcoffset().total_seconds() == 0  # type: ignore[union-attr]


@pytest.mark.parametrize("url", ["mysql://user:hunter2@host/name", "no url with hunter2", "mongodb://hunter2@host"])
def test_other_databases_are_refused_without_telling_the_password(url: str) -> None:
    with pytest.raises(InvalidInputError, match="expected") as raised:
        Database(url)
    assert "hunter2" not in str(raised.value)


@pytest.mark.parametrize("rest", ["", "/", "/:memory:", "/file:x?mode=memory&uri=true"])
def test_a_database_in_memory_is_refused(rest: str) -> None:
    """It would forget everything with each connection."""
    with pytest.raises(InvalidInputError, match="expected a file of SQLite"):
        Database(f"sqlite://{rest}")


@pytest.mark.parametrize("encoding", ["SQL_ASCII", "LATIN1"])
def test_a_database_that_cannot_store_every_text_is_refused(postgres_server: str, encoding: str) -> None:
    """Before, the first failed at the start, and the second at the first title in Japanese."""
    url = postgres.fresh_database(postgres_server, f"in_{encoding.lower()}", "template0", encoding)
    database = Database(url)
    with pytest.raises(InvalidInputError, match=f"encoding {encoding}, expected UTF8"), server_lock(database):
        pass
    assert inspect(database.engine).get_table_names() == []
    database.close()


def test_text_of_every_script_comes_back(database: Database) -> None:
    with database.session() as session:
        session.add(Agent(id="a", name="a", owner="o", description="東京 - Cup"))
    with database.reading() as session:
        assert session.scalars(select(Agent.description)).all() == ["東京 - Cup"]
