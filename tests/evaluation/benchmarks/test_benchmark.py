"""The version of a benchmark: what decides it, what does not, and that a changed copy has its own."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.benchmarks.documents import BENCHMARKS
from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.sumo_networks.errors import InvalidInputError


def test_a_changed_copy_has_a_version_of_its_own() -> None:
    quickstart = load_benchmark("quickstart")
    before = quickstart.sha256
    changed = quickstart.model_copy(update={"stop_on_collision": not quickstart.stop_on_collision})
    assert changed.sha256 != before
    assert type(changed).model_validate(changed.model_dump(mode="json")).sha256 == changed.sha256
    assert quickstart.sha256 == before


def test_default_seeds_and_texts_are_no_part_of_it() -> None:
    quickstart = load_benchmark("quickstart")
    for same in ({"seeds": (7,)}, {"description": "other words"}, {"metric": "other words"}):
        assert quickstart.model_copy(update=same).sha256 == quickstart.sha256


def test_the_headline_is_a_part_of_it() -> None:
    quickstart = load_benchmark("quickstart")
    assert quickstart.model_copy(update={"headline": Headline.IRS}).sha256 != quickstart.sha256


@pytest.mark.parametrize(
    ("name", "headline"),
    [
        ("quickstart", Headline.DRIVING_SCORE),
        ("leaderboard", Headline.DRIVING_SCORE),
        ("nocrash", Headline.NOCRASH_SUCCESS),
        ("corl2017", Headline.SUCCESS),
        ("endurance", Headline.DROVE_2500M),
        ("val14-reactive", Headline.CLOSED_LOOP),
    ],
)
def test_each_benchmark_has_its_headline_whatever_its_text_says(name: str, headline: Headline) -> None:
    benchmark = load_benchmark(name).model_copy(update={"metric": "driving score or success"})
    assert benchmark.headline is headline


@pytest.mark.parametrize("line", ["", 'headline = "sucess"'])
def test_a_file_without_a_known_headline_is_refused(line: str, tmp_path: Path) -> None:
    text = (BENCHMARKS / "quickstart.toml").read_text()
    (tmp_path / "mine.toml").write_text(text.replace('headline = "driving_score"', line))
    with pytest.raises(InvalidInputError, match=r"mine.toml.*: headline: "):
        load_benchmark(str(tmp_path / "mine.toml"))


@pytest.mark.parametrize("seed", [-1, 2**31, 1.5, True, "0"])
def test_seeds_that_are_none_are_one_clear_line(seed: Any) -> None:
    says = f"^benchmark 'quickstart': expected a seed, a whole number from 0 to 2147483647, got {seed!r}$"
    with pytest.raises(InvalidInputError, match=says):
        load_benchmark("quickstart").scenarios([0, seed])


@pytest.mark.parametrize("seeds", [3, "012"])
def test_what_is_no_list_of_seeds_is_refused(seeds: Any) -> None:
    with pytest.raises(InvalidInputError, match="benchmark 'quickstart': expected a list of seeds, got "):
        load_benchmark("quickstart").scenarios(seeds)


def test_a_seed_that_comes_twice_is_refused_before_anything_is_driven() -> None:
    with pytest.raises(InvalidInputError, match="benchmark 'quickstart': expected every seed once, got 3 again"):
        load_benchmark("quickstart").scenarios([3, 0, 3])


def of_cells(
    missions: Mapping[str, Sequence[str]], conditions: Sequence[str] = ("clear",), **changes: object
) -> Benchmark:
    """A benchmark with a cell of each name, which has missions of some names."""
    quickstart = load_benchmark("quickstart").model_dump(mode="json")
    one = quickstart["missions"]["all"][0]
    cells = [{"name": name, "network": "ingolstadt", "missions": name, "conditions": conditions} for name in missions]
    sets = {cell: [one | {"name": name} for name in names] for cell, names in missions.items()}
    return Benchmark.model_validate(quickstart | {"cells": cells, "missions": sets} | changes)


@pytest.mark.parametrize(
    ("missions", "conditions", "name"),
    [
        ({"a": ["one"]}, ["clear", "clear"], "one.clear"),
        ({"a": ["one", "one.clear"]}, ["wet", "clear.wet"], "one.clear.wet"),
        ({"a.b": ["c"], "a": ["b.c"]}, ["clear"], "a.b.c.clear"),
    ],
)
def test_two_scenarios_of_one_name_are_refused(
    missions: Mapping[str, Sequence[str]], conditions: Sequence[str], name: str
) -> None:
    with pytest.raises(ValueError, match=f"expected names of scenarios to be unique, got '{re.escape(name)}' again"):
        of_cells(missions, conditions, every_condition=True)


def test_cells_whose_missions_share_names_give_scenarios_of_different_names() -> None:
    made = of_cells({"a": ["one", "two"], "b": ["one"]}, ["clear", "wet", "clear"])
    assert [one.name for one in made.scenarios([0])] == ["a.one", "a.two", "b.one"]
    assert [one.conditions for one in made.scenarios([0])] == ["clear", "wet", "clear"]
    assert made.size == 3
    every = of_cells({"a": ["one"]}, ["clear", "wet"], every_condition=True)
    assert [(one.name, one.conditions) for one in every.scenarios([0])] == [("one.clear", "clear"), ("one.wet", "wet")]
