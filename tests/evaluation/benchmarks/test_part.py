"""Part of a benchmark: what names choose, and what a sample is made of."""

from __future__ import annotations

from itertools import pairwise

import pytest

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.benchmarks.part import sample_missions, select
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.scenario import Mission, Place, Scenario

EGO = Mission(name="ego", start=Place(lane="a_0", position_m=1.0), goal=Place(lane="b_0", position_m=1.0))


def scenario(name: str, cell: str = "all", conditions: str = "clear", seed: int = 0) -> Scenario:
    return Scenario(name=name, cell=cell, network="n", missions=(EGO,), conditions=conditions, seed=seed)


TOWNS = [
    scenario(f"{cell}.m{i}", cell, seed=seed)
    for seed in (0, 1)
    for cell, size in (("test.dense", 10), ("test.empty", 10), ("train.dense", 40))
    for i in range(size)
]


def names(scenarios: list[Scenario]) -> list[str]:
    return [one.name for one in scenarios]


@pytest.mark.parametrize(
    ("only", "count"),
    [
        (["test.dense"], 20),
        (["test.*"], 40),
        (["test.dense.m3"], 2),
        (["m3"], 6),
        (["m39", "test.empty"], 22),
        (["test.dense", "test.dense.m3"], 20),
        ([], 120),
    ],
)
def test_names_choose_cells_and_missions_with_all_their_seeds(only: list[str], count: int) -> None:
    chosen = select(TOWNS, only)
    assert len(chosen) == count
    assert chosen == [one for one in TOWNS if one in chosen]  # in the order given, each once


def test_a_mission_is_chosen_under_one_condition_or_all() -> None:
    both = [scenario(f"town.left.{one}", "town", one) for one in ("clear", "rain")]
    assert select(both, ["left"]) == both == select(both, ["town.left"])
    assert names(select(both, ["left.rain"])) == ["town.left.rain"]


def test_a_name_that_chooses_nothing_is_refused_with_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match=r"no cell or mission named 'test\.dens'; did you mean 'test\.dense'\?"):
        select(TOWNS, ["train.dense", "test.dens"])


@pytest.mark.parametrize("count", [6, 12, 30])
def test_a_sample_takes_from_each_cell_its_share(count: int) -> None:
    drawn = select(TOWNS, sample=count)
    assert len(drawn) == 2 * count
    per_cell = [len({one.name for one in drawn if one.cell == cell}) for cell in ("test.dense", "test.empty")]
    assert per_cell == [count // 6, count // 6]


def test_a_larger_sample_contains_the_smaller_ones() -> None:
    samples = [set(names(select(TOWNS, sample=count))) for count in range(1, 61)]
    assert all(a < b for a, b in pairwise(samples))


def test_a_sample_depends_on_the_names_alone() -> None:
    assert set(names(select(TOWNS[::-1], sample=7))) == set(names(select(TOWNS[:60], sample=7)))
    cells = dict.fromkeys(("through-east", "through-west", "left-to-south", "right-to-south"), "all")
    assert sample_missions(cells, 2) == {"left-to-south", "through-east"}  # stored results depend on it


def test_a_sample_is_drawn_from_the_chosen_missions() -> None:
    assert {one.cell for one in select(TOWNS, ["test.*"], sample=8)} == {"test.dense", "test.empty"}
    with pytest.raises(InvalidInputError, match=r"^sample: expected 1 to 20 missions, got 21"):
        select(TOWNS, ["test.*"], sample=21)


def test_scenarios_are_those_of_the_whole_benchmark() -> None:
    whole = load_benchmark("leaderboard").scenarios([0])
    assert all(one in whole for one in select(whole, sample=3))
