"""Gridlocked episodes under the scheduler: kept, driven once, and the run is done."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.records.store import read_record, read_trajectory, seal, write_record
from dohyo.service.boards.queries import entries
from dohyo.service.episodes.archive import shelve
from dohyo.service.evaluations.model import EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.evaluations.queries import count_missing
from dohyo.service.evaluations.scoring import lost_episodes, summarise_drives
from dohyo.service.scheduling import results
from dohyo.service.scheduling.queue import NO_SCORE
from dohyo.service.scheduling.scheduler import Scheduler
from dohyo.service.state import Broadcast
from dohyo.service.submissions.model import AgentKind
from tests.service.served import PATIENCE_S, STEADY, Service, info_of, short

pytestmark = pytest.mark.slow


@pytest.fixture
def shop(tmp_path: Path) -> Iterator[Service]:
    """What a scheduler in this process works on."""
    kept = Service(tmp_path / "data", processes=1)
    yield kept
    kept.close()


class Ending:
    """Lets drives end as lost: of each scenario, its attempts in turn; with no more statuses, as they did."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **statuses: list[Status]) -> None:
        self._statuses, self._real = statuses, shelve
        monkeypatch.setattr(results, "shelve", self)

    def __call__(self, settings: Any, staged: Path, scenario: Any) -> Any:
        if statuses := self._statuses.get(scenario.name.replace("-", "_")):
            record, trajectory = read_record(staged), read_trajectory(staged)
            write_record(staged.parent, staged.stem, seal(ended(record, statuses.pop(0))), trajectory)
        return self._real(settings, staged, scenario)


def ended(record: EpisodeRecord, status: Status) -> EpisodeRecord:
    egos = tuple(ego.model_copy(update={"status": status}) for ego in record.egos)
    return record.model_copy(update={"egos": egos})


def driven(shop: Service, missions: int = 2) -> str:
    """An evaluation that the scheduler has driven to its end."""
    evaluation = shop.submit(info_of(STEADY), short(missions), kind=AgentKind.BUILTIN)

    async def main() -> None:
        scheduler = Scheduler(shop.settings, shop.database, Broadcast())
        await scheduler.start()
        ends = time.monotonic() + PATIENCE_S
        while not shop.evaluation(evaluation).status.finished:
            assert time.monotonic() < ends, "the evaluation does not end"
            await asyncio.sleep(0.05)
        await scheduler.stop()

    asyncio.run(main())
    return evaluation


def test_a_gridlocked_episode_is_driven_once_and_its_record_is_kept(
    shop: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    Ending(monkeypatch, drive_0=[Status.GRIDLOCK] * 2)
    evaluation = driven(shop)
    run = shop.evaluation(evaluation)
    assert (run.status, run.failure) == (EvaluationStatus.DONE, None)
    assert [(one.status, one.attempts) for one in shop.episodes(evaluation)] == [(EpisodeStatus.DONE, 1)] * 2
    assert [one.outcome for one in shop.attempts(evaluation)] == ["done", "done"]
    assert shop.record(evaluation, 0).egos[0].status is Status.GRIDLOCK
    assert shop.record(evaluation, 1).egos[0].status.completed
    with shop.database.reading() as session:
        assert count_missing(session, session.get_one(Evaluation, evaluation)) == 0  # nothing to resume
        entry = entries(session, [evaluation])[evaluation]
    summary = summarise_drives(entry.drives, lost_episodes(sum(entry.lost.values()), entry.gridlocked))
    assert (summary["drives"], summary["lost"], summary["scores"]["success"]["mean"]) == (1, 1, 100.0)
    assert summary["scores_lost_as_zero"]["success"]["mean"] == 50.0


def test_a_run_without_a_drive_that_counts_is_done_and_says_why_it_has_no_score(
    shop: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    Ending(monkeypatch, drive_0=[Status.GRIDLOCK] * 2, drive_1=[Status.GRIDLOCK] * 2)
    run = shop.evaluation(driven(shop))
    assert (run.status, run.failure) == (EvaluationStatus.DONE, NO_SCORE)


def test_a_failed_simulation_is_still_driven_again(shop: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    Ending(monkeypatch, drive_0=[Status.SIMULATION])
    evaluation = driven(shop, missions=1)
    assert shop.evaluation(evaluation).status is EvaluationStatus.DONE
    assert [one.outcome for one in shop.attempts(evaluation)] == ["simulation", "done"]
    assert shop.record(evaluation).egos[0].status.completed
