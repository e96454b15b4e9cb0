"""The version of a benchmark: what decides it, what does not, and that a changed copy has its own."""

from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
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


@pytest.mark.parametrize("seed", [-1, 2**31])
def test_seeds_out_of_range_are_one_clear_line(seed: int) -> None:
    with pytest.raises(
        InvalidInputError, match=f"benchmark 'quickstart': expected seeds of 0 to 2147483647, got {seed}"
    ):
        load_benchmark("quickstart").scenarios([0, seed])


def test_a_seed_that_comes_twice_is_refused_before_anything_is_driven() -> None:
    with pytest.raises(InvalidInputError, match="benchmark 'quickstart': expected every seed once, got 3 again"):
        load_benchmark("quickstart").scenarios([3, 0, 3])
