"""The machine fails under the scheduler: a full disk, a locked database, one that drops its connections, a drain that
ends too early. Nothing finished is lost, nothing is counted twice, every evaluation ends with an honest status.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import subprocess
import threading
from collections.abc import Iterator
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pydantic import SecretStr
from sqlalchemy import create_engine, select, text
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from dohyo.service.database import patience
from dohyo.service.database.engine import Database
from dohyo.service.episodes.archive import archived_path
from dohyo.service.evaluations.model import Attempt, Episode, EpisodeStatus, EvaluationStatus
from dohyo.service.scheduling import queue, results, scheduler
from dohyo.service.scheduling.queue import Ticket
from dohyo.service.storage import usage
from dohyo.service.submissions.model import AgentKind
from tests.service.conftest import MakeService
from tests.service.scheduling.scheduled import Stop, scheduled, submit, until
from tests.service.served import PATIENCE_S, STEADY, Service, info_of, short, wait_until
from tests.service.workers.wire_worker import hire

pytestmark = pytest.mark.slow


@pytest.fixture
def shop(tmp_path: Path, database_url: str) -> Iterator[Service]:
    """What a scheduler in this process works on, on SQLite and on PostgreSQL."""
    kept = Service(tmp_path / "data", database=SecretStr(database_url), processes=1)
    yield kept
    kept.close()


@contextlib.contextmanager
def locked(shop: Service) -> Iterator[None]:
    """Somebody else writes, and does not end."""
    engine = create_engine(shop.database.engine.url)
    sqlite = engine.dialect.name == "sqlite"
    with engine.connect() as connection:
        if sqlite:
            connection.connection.isolation_level = None  # type: ignore[attr-defined]
        connection.execute(text("BEGIN IMMEDIATE" if sqlite else "LOCK TABLE episodes IN ACCESS EXCLUSIVE MODE"))
        yield
        connection.execute(text("ROLLBACK")) if sqlite else connection.rollback()
    engine.dispose()


def test_a_locked_database_delays_a_start_and_a_result_and_loses_none(
    shop: Service, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The lock comes before the episode's first query, and again between its drive and the storing of its result."""
    monkeypatch.setattr(patience, "RETRY_S", (0.1,))
    reads = [] if shop.database.is_sqlite else [(usage, "check_bytes")]  # SQLite's readers wait for nobody
    stops = []
    for module, step in (*reads, (results, "shelve")):
        stops.append(Stop(getattr(module, step)))
        monkeypatch.setattr(module, step, stops[-1])
    evaluation = submit(shop, "steady")

    def refused() -> int:
        return sum("the database refuses" in record.getMessage() for record in caplog.records)

    async def main() -> None:
        async with scheduled(shop, busy_s=0.3):
            for stop in stops:
                await until(stop.reached.is_set)
                caplog.clear()
                with locked(shop):
                    stop.may_go_on.set()
                    await until(lambda: refused() >= 2)
            await until(lambda: shop.evaluation(evaluation).status.finished)

    asyncio.run(main())
    (episode,) = shop.episodes(evaluation)
    assert (episode.status, episode.attempts) == (EpisodeStatus.DONE, 1)
    assert [one.outcome for one in shop.attempts(evaluation)] == ["done"]
    assert shop.record(evaluation).egos[0].status.completed


def test_a_record_that_a_deletion_removes_as_it_is_stored_is_archived_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An evaluation with the same record may be deleted between the two."""
    shop, real = Service(tmp_path / "data", processes=1), queue.finish

    def finish(session: Session, ticket: Ticket, record_hash: str, *rest: Any) -> Any:
        for file in archived_path(shop.settings, record_hash).parent.glob(f"{record_hash}.*"):
            file.unlink()
        return real(session, ticket, record_hash, *rest)

    monkeypatch.setattr(queue, "finish", finish)
    evaluation = submit(shop, "steady")

    async def main() -> None:
        async with scheduled(shop):
            await until(lambda: shop.evaluation(evaluation).status.finished)

    asyncio.run(main())
    assert shop.record(evaluation).egos[0].status.completed
    shop.close()


def began(episode: Episode) -> datetime:
    assert episode.started is not None
    return episode.started


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_owners_drive_side_by_side_and_dropped_connections_cost_nothing(shop: Service) -> None:
    first = submit(shop, "first", missions=3, owner="early")
    second = submit(shop, "second", missions=2, owner="late")

    async def main() -> None:
        async with scheduled(shop):
            await until(lambda: shop.episodes(first)[0].status is EpisodeStatus.DONE)
            with shop.database.session() as session:
                others = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid()"
                session.execute(text(f"{others} AND datname = current_database()"))
            await until(lambda: all(shop.evaluation(one).status.finished for one in (first, second)))

    asyncio.run(main())
    early, late = shop.episodes(first), shop.episodes(second)
    # One process, and one more for an owner of whom nothing runs: each owner drives in one, whatever a drive takes.
    assert began(late[0]) < began(early[1]), "an owner waits for the other's whole evaluation"
    for mine in (early, late):
        for before, after in pairwise(mine):
            assert before.finished is not None
            assert before.finished <= began(after), "an owner holds two processes"
    episodes = [*early, *late]
    assert {(one.status, one.attempts) for one in episodes} == {(EpisodeStatus.DONE, 1)}
    assert shop.hashes(first)[0] is not None


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 4 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(folder)]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("no file system can be mounted here: a full disk needs root")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def fill(folder: Path) -> Path:
    """Takes every byte that is left."""
    ballast = folder / "ballast"
    with ballast.open("ab", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(b"x" * 4096)
    return ballast


def test_a_full_disk_costs_an_attempt_and_nothing_that_was_done(small_disk: Path) -> None:
    service = Service(small_disk / "data", processes=1)
    try:
        done = service.submit(info_of(STEADY), short(), kind=AgentKind.BUILTIN)
        service.start()
        hashes = service.hashes(done)
        evaluation = service.submit(info_of(STEADY), short())
        worker = hire(service)
        episode = worker.acquire()
        reply, status = worker.drive(episode, steps=3), 200
        ballast = fill(small_disk)
        while status == 200:
            assert not reply["done"], "the record cannot be on the disk"
            status, reply = worker.step(episode["lease"], reply["tick"], {"ego": [6.0, 0.0]})
        assert (status, "the simulation failed" in reply["detail"]) == (410, True), reply
        assert service.evaluation(evaluation).status is EvaluationStatus.RUNNING
        assert service.hashes(done) == hashes
        ballast.unlink()
        again = worker.acquire()
        assert (again["attempt"], again["tick"]) == (2, 0)
        worker.drive(again)
        assert service.hashes(evaluation) == hashes
        attempts = [one for one in service.attempts(evaluation) if one.outcome != "unclaimed"]
        assert [(one.outcome, one.charged) for one in attempts] == [("simulation", False), ("done", False)]
        assert "No space left" in (attempts[0].why or "")
    finally:
        service.close()


def test_drives_that_outlast_the_drain_are_queued_again_and_a_step_under_way_is_told_abort(
    make_service: MakeService,
) -> None:
    service = make_service(drain_s=5.0)
    infos = [info_of(STEADY).model_copy(update={"name": name}) for name in ("steps", "waits")]
    evaluations = [service.submit(info, short()) for info in infos]
    service.start()
    workers = [hire(service, info.name) for info in infos]
    episodes = [worker.acquire() for worker in workers]
    replies = [worker.drive(episode, steps=3) for worker, episode in zip(workers, episodes, strict=True)]
    processes = service.episode_processes()
    assert len(processes) == 2
    for process in processes:
        os.kill(process, signal.SIGSTOP)  # the simulation stands still: the step is under way when the drain ends
    answers: list[Any] = []
    begun = threading.Event()

    def step() -> None:
        begun.set()
        answers.append(workers[0].step(episodes[0]["lease"], replies[0]["tick"], {"ego": [6.0, 0.0]}))

    stepping = threading.Thread(target=step)
    stepping.start()
    begun.wait()
    assert service.terminate() == 0  # the step arrives before the drain ends
    stepping.join(PATIENCE_S)
    ((status, last),) = answers
    assert (status, last["directive"], last["done"], last["observations"]) == (200, "abort", True, {})
    for evaluation in evaluations:
        (left,) = service.episodes(evaluation)
        assert (left.status, left.attempts) == (EpisodeStatus.QUEUED, 0)
        assert service.evaluation(evaluation).status is EvaluationStatus.RUNNING
    wait_until(lambda: not any(Path(f"/proc/{one}").exists() for one in processes), "episode processes are left")


def test_an_episode_that_is_taken_as_the_service_stops_is_queued_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The stop comes before the commit of the take, in a thread that nobody can stop."""
    shop, taking = Service(tmp_path / "data", processes=1, drain_s=0.0), Stop(queue.take)
    monkeypatch.setattr(queue, "take", taking)
    evaluation = submit(shop, "steady", missions=2)

    async def main() -> None:
        async with scheduled(shop) as running:
            await until(taking.reached.is_set)
            stopping = asyncio.create_task(running.stop())
            await asyncio.wait([stopping], timeout=0.5)  # it goes as far as it can
            taking.may_go_on.set()
            await stopping

    asyncio.run(main())
    assert [(one.status, one.attempts) for one in shop.episodes(evaluation)] == [(EpisodeStatus.QUEUED, 0)] * 2
    assert [one.outcome for one in shop.attempts(evaluation)] == ["drained"]
    shop.close()


def test_the_end_of_the_drain_cuts_no_episode_off_that_goes_back_to_the_queue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The drain itself gives back what no worker has claimed; the database is busy until the drain ends."""
    shop, real = Service(tmp_path / "data", processes=1, drain_s=1.0), results.Results.requeue
    evaluation = shop.submit(info_of(STEADY).model_copy(update={"name": "steady"}), short())

    async def main() -> None:
        async with scheduled(shop) as running:

            async def late(stores: results.Results, ticket: Ticket) -> None:
                await until(lambda: running._stopped)
                await real(stores, ticket)

            monkeypatch.setattr(results.Results, "requeue", late)
            running.leases.register("steady", "owner", "token", capacity=1, version=None)
            running.wake()
            await until(lambda: running.snapshot()["running"] == 1)

    asyncio.run(main())
    (episode,) = shop.episodes(evaluation)
    assert (episode.status, episode.attempts) == (EpisodeStatus.QUEUED, 0)
    shop.close()


def test_a_cancellation_before_an_episode_takes_its_first_step_frees_its_place(
    shop: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The start of an episode and its cancellation come in one turn of the event loop; there is one process."""
    create, cancelled = asyncio.create_task, list[str]()

    def cancelled_at_once(work: Any, **options: Any) -> Any:
        task = create(work, **options)
        if work.__qualname__ == "Scheduler._drive" and not cancelled:
            cancelled.append(task.get_name())
            task.cancel()
        return task

    async def main() -> None:
        async with scheduled(shop) as running:
            first = submit(shop, "first")
            await until(lambda: bool(cancelled))
            await running.cancel(first)
            second = submit(shop, "second")
            await until(lambda: shop.evaluation(second).status is EvaluationStatus.DONE)
            assert shop.evaluation(first).status is EvaluationStatus.CANCELLED
            await until(lambda: running.snapshot()["running"] == 0)

    monkeypatch.setattr(asyncio, "create_task", cancelled_at_once)
    asyncio.run(main())


def test_an_episode_whose_taking_was_committed_without_an_answer_is_driven(
    shop: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The connection breaks between the commit and its answer, so that the scheduler does not know of the episode."""
    monkeypatch.setattr(scheduler, "LOOK_S", 0.1)
    monkeypatch.setattr(scheduler, "RETRY_S", 0.1)
    real, broken = Database.session, list[bool]()
    evaluation = submit(shop, "steady", missions=2)

    @contextlib.contextmanager
    def unanswered(database: Database) -> Iterator[Session]:
        with real(database) as session:
            yield session
            takes = bool(session.scalars(select(Attempt).where(Attempt.ended.is_(None))).first())
        if takes and not broken:
            broken.append(True)
            raise OperationalError("COMMIT", {}, RuntimeError("server closed the connection unexpectedly"))

    monkeypatch.setattr(Database, "session", unanswered)

    async def main() -> None:
        async with scheduled(shop):
            await until(lambda: shop.evaluation(evaluation).status.finished)

    asyncio.run(main())
    assert [(one.status, one.attempts) for one in shop.episodes(evaluation)] == [(EpisodeStatus.DONE, 1)] * 2
    assert [one.outcome for one in shop.attempts(evaluation)] == ["drained", "done", "done"]
