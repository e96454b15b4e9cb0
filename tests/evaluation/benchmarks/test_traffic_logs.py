"""Logs are made by driving the reference, once, and checked against what the scenario asked for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.benchmarks.traffic_logs import Reference, drive_reference, missing_logs, prepare_logs
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.running.run import run_benchmark
from dohyo.evaluation.scores.nuplan.summary import by_type, compare_closed_loop, score_records, summarise_closed_loop
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from dohyo.sumo_networks.simulation.traffic_log import log_path, read_log

LANE = "B1C1_0"
REFERENCE = load_benchmark("val14").reference_agent or ""


@pytest.fixture(autouse=True)
def _home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("DOHYO_HOME", str(tmp_path))
    read_log.cache_clear()
    yield
    read_log.cache_clear()


def first_mission() -> Benchmark:
    """The first mission of val14 on the small district, alone, for 3 s."""
    whole = load_benchmark("val14")
    cell = next(cell for cell in whole.cells if cell.network == "district")
    missions = whole.missions[cell.missions][:1]
    return whole.model_copy(
        update={"cells": (cell,), "missions": {cell.missions: missions}, "duration_s": 3.0, "replay": False}
    )


@pytest.fixture(scope="module")
def driven() -> tuple[Scenario, Reference]:
    scenario = first_mission().scenarios([0])[0]
    return scenario, drive_reference(scenario, REFERENCE)


def test_the_reference_drives_as_the_same_agent_does_in_the_live_scenario(driven: tuple[Scenario, Reference]) -> None:
    scenario, reference = driven
    assert reference.log.ticks == 31
    record, _ = drive_episode(scenario, {"ego": make_agent(REFERENCE)})
    assert record.egos[0].status is Status.FINISHED
    assert record.egos[0].duration_s == 3.0
    assert record.egos[0].progress_m == pytest.approx(reference.progress_m, abs=0.01)


def test_logs_are_made_once_and_replayed(driven: tuple[Scenario, Reference], tmp_path: Path) -> None:
    scenario, reference = driven
    replayed = scenario.model_copy(update={"log": reference.log.sha256()})
    assert missing_logs([scenario, replayed]) == [replayed]
    seen: list[tuple[int, int]] = []
    assert prepare_logs([scenario, replayed], REFERENCE, progress=lambda done, total: seen.append((done, total))) == 1
    assert seen == [(0, 1), (1, 1)]
    assert log_path(reference.log.sha256()).exists()
    assert prepare_logs([replayed], None) == 0
    record, _ = drive_episode(replayed, {"ego": make_agent(REFERENCE)})
    assert record.egos[0].progress_m == pytest.approx(reference.progress_m, abs=0.1)


def test_a_reference_that_drives_otherwise_than_it_did_is_refused(driven: tuple[Scenario, Reference]) -> None:
    other = driven[0].model_copy(update={"log": "0" * 64})
    with pytest.raises(InvalidInputError, match=r"expected log 000000000000.*has changed since.*--pin"):
        prepare_logs([other], REFERENCE)
    assert not log_path("0" * 64).exists()


def test_a_missing_log_needs_an_agent_that_makes_it(driven: tuple[Scenario, Reference]) -> None:
    other = driven[0].model_copy(update={"log": "0" * 64})
    with pytest.raises(InvalidInputError, match="no reference_agent makes it"):
        prepare_logs([other], None)


def test_a_scenario_without_an_end_has_no_log() -> None:
    place = Place(lane=LANE)
    endless = Scenario(network="district", missions=(Mission(start=place, goal=place),), traffic=Traffic())
    with pytest.raises(InvalidInputError, match="expected a duration"):
        drive_reference(endless, REFERENCE)


def test_an_evaluation_makes_its_logs_and_is_scored(driven: tuple[Scenario, Reference], tmp_path: Path) -> None:
    live = first_mission()
    cell = live.cells[0]
    mission = live.missions[cell.missions][0]
    assert mission.excerpt is not None
    news = {"log": driven[1].log.sha256(), "reference_m": driven[1].progress_m}
    pinned = mission.model_copy(update={"excerpt": mission.excerpt.model_copy(update=news)})
    benchmark = live.model_copy(update={"missions": {cell.missions: (pinned,)}, "replay": True})
    result = run_benchmark(benchmark, REFERENCE, out=tmp_path / "out")
    drives = score_records(zip(result.records, result.paths, strict=True))
    summary = summarise_closed_loop(drives)
    assert list(by_type(drives)) == [cell.name.partition(".")[0]]
    assert summary.progress.mean == pytest.approx(100.0, abs=0.5)
    assert summary.collisions.mean == 0.0
    assert compare_closed_loop(drives, drives).verdict == "="
