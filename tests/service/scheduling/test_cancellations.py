"""An evaluation is cancelled at bad moments: nothing of the old attempt reaches a new one, or is left on the disk."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import SecretStr

from dohyo.service.evaluations.model import EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.evaluations.queries import resume
from dohyo.service.running.process import EpisodeProcess, Outcome
from dohyo.service.scheduling import queue, results, scheduler
from dohyo.service.scheduling.scheduler import Scheduler
from dohyo.service.state import Broadcast
from tests.service.scheduling.scheduled import Stop, scheduled, submit, until
from tests.service.served import Service


@pytest.fixture
def shop(tmp_path: Path, database_url: str) -> Iterator[Service]:
    """What a scheduler in this process works on, on SQLite and on PostgreSQL."""
    kept = Service(tmp_path / "data", database=SecretStr(database_url), processes=2)
    yield kept
    kept.close()


def resumed(shop: Service, evaluation: str) -> None:
    with shop.database.session() as session:
        assert resume(session, session.get_one(Evaluation, evaluation)) == 1


def test_a_resumed_episode_is_driven_once_the_cancelled_drive_has_ended(
    shop: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The old process takes its time to end; it has the staging files that the new one will write."""
    monkeypatch.setattr(scheduler, "LOOK_S", 0.1)
    drive, close, orders = EpisodeProcess.drive, EpisodeProcess.close, list[Any]()
    complaints = list[dict[str, Any]]()

    async def main() -> None:
        may_close = asyncio.Event()
        asyncio.get_running_loop().set_exception_handler(lambda _, complaint: complaints.append(complaint))

        async def endless_at_first(process: EpisodeProcess, order: Any, limit_s: float) -> Outcome:
            orders.append(order)
            if len(orders) > 1:
                return await drive(process, order, limit_s)
            try:
                await asyncio.Event().wait()
            finally:
                process.kill()
            raise AssertionError("unreachable")

        async def late(process: EpisodeProcess) -> None:
            await may_close.wait()
            await close(process)

        monkeypatch.setattr(EpisodeProcess, "drive", endless_at_first)
        monkeypatch.setattr(EpisodeProcess, "close", late)
        async with scheduled(shop) as running:
            evaluation = submit(shop, "first")
            await until(lambda: bool(orders))
            cancelling = asyncio.create_task(running.cancel(evaluation))
            await until(lambda: shop.evaluation(evaluation).status is EvaluationStatus.CANCELLED)
            resumed(shop, evaluation)
            other = submit(shop, "second", owner="another")  # it waits for nothing
            running.wake()
            await until(lambda: shop.evaluation(other).status is EvaluationStatus.DONE)
            assert shop.episodes(evaluation)[0].status is EpisodeStatus.QUEUED
            may_close.set()
            await cancelling
            await until(lambda: shop.evaluation(evaluation).status.finished)
            await until(lambda: running.snapshot()["running"] == 0)
        assert [one.outcome for one in shop.attempts(evaluation)] == ["cancelled", "done"]

    asyncio.run(main())
    assert len(orders) == 3
    assert not complaints


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_cancellation_that_comes_after_the_end_cuts_nothing_off(
    shop: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last result is stored, and not told yet."""
    storing, events, told = Stop(results.ensure_archived), Broadcast(), list[tuple[str, Any]]()
    events.watch(lambda topic, data: told.append((topic, data.get("status"))))
    monkeypatch.setattr(results, "ensure_archived", storing)
    evaluation = submit(shop, "steady")

    async def main() -> None:
        async with scheduled(shop, events) as running:
            await until(lambda: shop.evaluation(evaluation).status is EvaluationStatus.DONE)
            await running.cancel(evaluation)
            storing.may_go_on.set()
            await until(lambda: running.snapshot()["running"] == 0)

    asyncio.run(main())
    assert ("evaluations", "done") in told
    assert not list(shop.settings.staging.iterdir())


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_record_of_a_cancelled_episode_is_not_kept_unless_another_episode_has_it(
    shop: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The cancellation comes when the record is in the archive, and not in the database."""
    finish = queue.finish

    async def cancelled(running: Scheduler) -> None:
        storing = Stop(finish)
        monkeypatch.setattr(queue, "finish", storing)
        evaluation = submit(shop, "steady")
        running.wake()
        await until(storing.reached.is_set)
        assert files(shop)
        cancelling = asyncio.create_task(running.cancel(evaluation))
        await until(lambda: shop.evaluation(evaluation).status is EvaluationStatus.CANCELLED)
        storing.may_go_on.set()
        await cancelling
        await until(lambda: running.snapshot()["running"] == 0)
        monkeypatch.setattr(queue, "finish", finish)

    async def main() -> None:
        async with scheduled(shop) as running:
            await cancelled(running)
            assert not files(shop)
            kept = submit(shop, "steady")
            running.wake()
            await until(lambda: shop.evaluation(kept).status.finished)
            await cancelled(running)
            assert shop.record(kept).egos[0].status.completed

    asyncio.run(main())
    assert not list(shop.settings.staging.iterdir())


def files(shop: Service) -> list[Path]:
    """All files of the archive."""
    return [file for file in shop.settings.records.rglob("*") if file.is_file()]
