"""Benchmarks whose missions begin in the midst of recorded traffic, and what val14 must hold."""

from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.sumo_networks.errors import InvalidInputError

PLAIN = {
    "name": "mine",
    "description": "",
    "headline": "closed_loop",
    "metric": "closed-loop score",
    "network": "district",
    "traffic": {"vehicles": 3},
    "seeds": [0],
    "duration_s": 15.0,
    "replay": True,
    "reference_agent": "somewhere:Expert",
}
EXCERPT = {"seed": 7, "warm_up_s": 12.5, "reference_m": 80.5, "log": "ab" * 32}


def mine(**changes: object) -> Benchmark:
    val14 = load_benchmark("val14")
    some = next(val14.missions[cell.missions][0] for cell in val14.cells if cell.network == "district")
    mission = some.model_dump() | {"name": "m01", "excerpt": EXCERPT, "events": []}
    return Benchmark.model_validate(PLAIN | {"missions": [mission]} | changes)


def test_an_excerpt_decides_seed_warm_up_reference_and_log() -> None:
    (scenario,) = mine().scenarios([0])
    assert (scenario.seed, scenario.traffic.warm_up_s, scenario.traffic.vehicles) == (7, 12.5, 3)
    assert (scenario.reference_m, scenario.log, scenario.duration_s) == (80.5, "ab" * 32, 15.0)
    assert scenario.missions[0].start_speed_mps is not None


def test_without_replay_the_others_live() -> None:
    (scenario,) = mine(replay=False).scenarios([0])
    assert (scenario.log, scenario.reference_m) == (None, 80.5)
    assert mine(replay=False).sha256 != mine().sha256


def test_seeds_are_those_of_the_excerpts() -> None:
    with pytest.raises(InvalidInputError, match="seeds of their own"):
        mine().scenarios([0, 1])


@pytest.mark.parametrize("seeds", [[0, 1, 2], [7]])
def test_other_seeds_in_the_file_are_refused_there(seeds: list[int]) -> None:
    with pytest.raises(ValueError, match=r"seeds: expected \[0\], since missions with an excerpt have seeds of their"):
        mine(seeds=seeds)


def test_a_file_without_seeds_is_told_which_it_needs() -> None:
    given = {key: value for key, value in mine().model_dump().items() if key != "seeds"}
    with pytest.raises(ValueError, match=r"seeds: expected \[0\]"):
        Benchmark.model_validate(given)


def test_replay_needs_a_duration() -> None:
    with pytest.raises(ValueError, match="duration_s"):
        mine(duration_s=None)


def plain(**changes: object) -> dict[str, object]:
    """The mission without its excerpt."""
    return mine().missions["all"][0].model_dump() | {"excerpt": None} | changes


def test_a_closed_loop_headline_needs_references() -> None:
    with pytest.raises(ValueError, match="'closed_loop': expected an excerpt in every mission, for its reference_m"):
        mine(missions=[plain()], replay=False)


def test_replay_needs_logs_of_all_missions() -> None:
    both = [mine().missions["all"][0].model_dump(), plain(name="m02")]
    for missions in (both, both[1:]):
        with pytest.raises(ValueError, match="replay: expected an excerpt in every mission, for its log"):
            mine(missions=missions, headline="driving_score")


def test_missions_with_an_excerpt_are_driven_one_at_a_time() -> None:
    cell = {"name": "both", "network": "district", "missions": "all", "together": True}
    given = {key: value for key, value in PLAIN.items() if key not in ("network", "traffic")}
    first = mine().missions["all"][0].model_dump()
    for missions in ([first], [first, plain(name="m02")]):
        changes = {"headline": "driving_score", "replay": False, "cells": [cell], "missions": {"all": missions}}
        with pytest.raises(ValueError, match="cell 'both': expected together = false, since its missions have exc"):
            Benchmark.model_validate(given | changes)


@pytest.mark.parametrize("together", [False, True])
def test_a_duration_holds_without_excerpts(together: bool) -> None:
    cell = {"name": "all", "network": "district", "missions": "all", "together": together}
    changes = {"headline": "driving_score", "replay": False, "network": None, "traffic": None, "cells": [cell]}
    given = {key: value for key, value in (PLAIN | changes).items() if value is not None}
    (scenario,) = Benchmark.model_validate(given | {"missions": {"all": [plain()]}}).scenarios([0])
    assert (scenario.duration_s, scenario.log, scenario.reference_m) == (15.0, None, None)


@pytest.mark.parametrize("agent", [None, "Expert", "somewhere.Expert", "os; x:Expert"])
def test_replay_needs_an_agent_that_makes_the_logs(agent: str | None) -> None:
    with pytest.raises(ValueError, match="reference_agent"):
        mine(reference_agent=agent)


def test_a_file_like_another_says_only_what_differs(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(Path("evaluation/benchmarks/quickstart.toml").read_text())
    (tmp_path / "b.toml").write_text('like = "a"\nname = "b"\n')
    a, b = load_benchmark(str(tmp_path / "a.toml")), load_benchmark(str(tmp_path / "b.toml"))
    assert b.name == "b"
    assert b.missions == a.missions
    assert a.sha256 != b.sha256


@pytest.mark.parametrize("name", ["nocrash", "leaderboard", "precrash", "quickstart"])
def test_benchmarks_without_excerpts_have_no_new_fields(name: str) -> None:
    benchmark = load_benchmark(name)
    assert not benchmark.excerpts
    assert not benchmark.closed_loop
    assert not {"duration_s", "replay"} & set(benchmark.model_dump())


def test_val14_is_of_four_networks_and_fifteen_seconds() -> None:
    val14 = load_benchmark("val14")
    assert set(val14.networks) == {"adlershof", "braunschweig", "ingolstadt", "district"}
    assert val14.duration_s == 15.0


def test_the_reactive_benchmark_has_the_same_scenarios_but_alive() -> None:
    replayed, live = load_benchmark("val14").scenarios([0]), load_benchmark("val14-reactive").scenarios([0])
    assert all(one.log for one in replayed)
    assert [one.model_copy(update={"log": None}) for one in replayed] == live
