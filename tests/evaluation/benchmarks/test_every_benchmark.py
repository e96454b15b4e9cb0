"""Every benchmark that comes with dohyo, in short form: same hashes in any order; only what is missing is driven."""

from __future__ import annotations

from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from dohyo.evaluation.benchmarks.benchmark import Benchmark, TimeLimit, load_benchmark
from dohyo.evaluation.benchmarks.documents import benchmark_names
from dohyo.evaluation.families import Family
from dohyo.evaluation.running.executors import ProcessPool
from dohyo.evaluation.running.run import run_benchmark
from dohyo.sumo_networks.scenario import Scenario

AGENT = "dohyo.agents.experts.autopilot:Autopilot"


def shortened(benchmark: Benchmark) -> Benchmark:
    """A mission of the first cell and one of the last, five seconds each, among few."""
    cells = tuple(dict.fromkeys((benchmark.cells[0], benchmark.cells[-1])))
    few = {"vehicles": 5, "bicycles": 1, "pedestrians": 0, "warm_up_s": 2.0}
    cells = tuple(cell.model_copy(update={"traffic": cell.traffic.model_copy(update=few)}) for cell in cells)
    missions = {cell.missions: benchmark.missions[cell.missions][:1] for cell in cells}
    update = {"cells": cells, "missions": missions, "time_limit": TimeLimit(speed_kmh=1000.0, extra_s=5.0)}
    return benchmark.model_copy(update=update)


@cache
def scenarios_of(name: str) -> tuple[Scenario, ...]:
    """Those of seed 0, which several tests look at."""
    return tuple(load_benchmark(name).scenarios([0]))


@pytest.mark.slow
@pytest.mark.parametrize("name", benchmark_names(Family.DRIVING))
def test_order_and_resuming_change_no_hash(name: str, tmp_path: Path) -> None:
    short = shortened(load_benchmark(name))
    first = run_benchmark(short, AGENT, seeds=[0], out=tmp_path / "a", executor=ProcessPool(1))
    hashes = [record.record_hash for record in first.records]
    first.paths[0].unlink()
    again = run_benchmark(short, AGENT, seeds=[0], out=tmp_path / "a", executor=ProcessPool(1), reverse=True)
    assert again.resumed == len(hashes) - 1
    assert [record.record_hash for record in again.records] == hashes


@pytest.mark.parametrize("name", benchmark_names(Family.DRIVING))
def test_every_scenario_can_be_driven_and_says_what_it_measures(name: str) -> None:
    benchmark, scenarios = load_benchmark(name), scenarios_of(name)
    assert len({(scenario.name, scenario.seed) for scenario in scenarios}) == len(scenarios)
    assert benchmark.metric.startswith(benchmark.headline.label)


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("nocrash", 300),
        ("nocrash-original", 900),
        ("corl2017", 400),
        ("obstacles", 159),
        ("precrash", 84),
        ("leaderboard", 20),
        ("leaderboard-train", 90),
        ("endurance", 20),
    ],
)
def test_they_are_as_long_as_they_say(name: str, count: int) -> None:
    assert len(scenarios_of(name)) == load_benchmark(name).size == count


def test_the_original_protocol_drives_every_mission_under_every_condition_at_10_km_h() -> None:
    ours, original = (load_benchmark(name).scenarios([1]) for name in ("nocrash", "nocrash-original"))
    driven = Counter((one.cell, one.missions[0].start.lane, one.missions[0].goal.lane) for one in original)
    assert Counter(driven.values()) == {4: 150, 2: 150}
    assert len({(one.cell, one.missions, one.conditions) for one in original}) == 900
    for one in ours:
        twin = next(other for other in original if other.name == f"{one.name}.{one.conditions}")
        assert (twin.missions, twin.traffic, twin.stop_on_collision) == (one.missions, one.traffic, True)
        assert twin.time_limit_s is not None
        assert one.time_limit_s == pytest.approx(2.0 * twin.time_limit_s + 20.0, abs=0.2)


def test_obstacles_are_81_vehicles_and_78_pedestrians() -> None:
    kinds = [event.kind for scenario in scenarios_of("obstacles") for event in scenario.events]
    assert (kinds.count("vehicle_appears"), kinds.count("pedestrian_steps_out")) == (81, 78)


def test_the_leaderboards_share_no_mission() -> None:
    def places(name: str) -> set[tuple[str, str]]:
        missions = load_benchmark(name).missions.values()
        return {(one.start.lane, one.goal.lane) for some in missions for one in some}

    assert not places("leaderboard") & places("leaderboard-train")
