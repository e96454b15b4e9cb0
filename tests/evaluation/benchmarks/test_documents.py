"""Families of benchmarks: found by a name or by the kind in a file, with one line for every mistake."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.benchmarks.documents import benchmark_names, benchmark_path, find_family
from dohyo.evaluation.families import Family
from dohyo.evaluation.freeway.benchmark import load_forecasting, load_traffic
from dohyo.evaluation.parking.benchmark import load_parking_benchmark
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

LOAD: dict[Family, Callable[[str], object]] = {
    Family.DRIVING: load_benchmark,
    Family.FREEWAY: load_traffic,
    Family.FORECASTING: load_forecasting,
    Family.PARKING: load_parking_benchmark,
}


@pytest.mark.parametrize("family", Family)
def test_a_family_is_found_by_name_and_by_file_and_loads_as_no_other(family: Family) -> None:
    assert benchmark_names(family)
    for name in benchmark_names(family):
        assert find_family(name) is find_family(str(benchmark_path(name, family))) is family
    path = str(benchmark_path(benchmark_names(family)[0], family))
    for other in set(Family) - {family}:
        with pytest.raises(
            InvalidInputError, match=f"expected a benchmark of {other.label}, got one of {family.label}"
        ):
            LOAD[other](path)


def test_no_two_families_share_a_name() -> None:
    names = [name for family in Family for name in benchmark_names(family)]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("name", ["quickstart", "dissipation", "parking-angled"])
def test_an_unknown_name_gets_a_hint_from_all_families(name: str) -> None:
    with pytest.raises(UnknownNameError, match=f"did you mean '{name}'"):
        find_family(name[:-1])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('kind = "sailing"', "kind: expected 'forecast', 'traffic', 'parking', or no kind .*, got 'sailing'"),
        ("kind = []", r"kind: expected 'forecast', .* got \[\]"),
        ("kind = ", "is not valid TOML"),
        (None, "cannot read benchmark file '.*mine.toml': No such file"),
    ],
)
def test_a_file_of_no_family_is_refused_in_one_line(text: str | None, message: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    if text is not None:
        path.write_text(text)
    for read in (find_family, *LOAD.values()):
        with pytest.raises(InvalidInputError, match=message) as told:
            read(str(path))
        assert "\n" not in str(told.value)


def test_a_file_that_is_like_itself_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('like = "b"\n')
    (tmp_path / "b.toml").write_text('like = "a"\n')
    with pytest.raises(InvalidInputError, match="like: expected another file, got 'a' again"):
        find_family(str(tmp_path / "a.toml"))
