"""Benchmarks of the freeway: their files, their versions, and where their days lie."""

from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.evaluation.benchmarks.documents import benchmark_names, benchmark_path
from dohyo.evaluation.families import Family
from dohyo.evaluation.freeway.benchmark import (
    ForecastBenchmark,
    TrafficBenchmark,
    days_folder,
    load_freeway_benchmark,
)
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.freeway.dataset import day_orders


def test_the_benchmarks_that_come_with_dohyo() -> None:
    assert benchmark_names(Family.FREEWAY) == ["dissipation"]
    assert benchmark_names(Family.FORECASTING) == ["forecast-easy", "forecast-hard"]
    for name in (*benchmark_names(Family.FREEWAY), *benchmark_names(Family.FORECASTING)):
        assert load_freeway_benchmark(name).name == name


def test_hard_is_of_single_vehicles_and_easy_of_whole_days() -> None:
    for name, scale, minutes in (("forecast-easy", "meso", 1440), ("forecast-hard", "micro", 440)):
        benchmark = load_freeway_benchmark(name)
        assert isinstance(benchmark, ForecastBenchmark)
        days = list(day_orders(benchmark.order))
        assert len(days) == benchmark.number
        assert {day.scale for day in days} == {scale}
        assert {day.scenario.duration_s / 60 for day in days} == {minutes}


def test_the_version_tells_what_decides_and_nothing_else() -> None:
    dissipation = load_freeway_benchmark("dissipation")
    assert isinstance(dissipation, TrafficBenchmark)
    for same in ({"seeds": (7,)}, {"description": "other words"}):
        assert dissipation.model_copy(update=same).sha256 == dissipation.sha256
    assert dissipation.model_copy(update={"penetration": 0.04}).sha256 != dissipation.sha256


def test_days_of_another_seed_lie_elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("DOHYO_HOME", str(tmp_path))
    easy, hard = (load_freeway_benchmark(f"forecast-{name}") for name in ("easy", "hard"))
    assert isinstance(easy, ForecastBenchmark)
    assert isinstance(hard, ForecastBenchmark)
    assert days_folder(easy) == days_folder(hard)  # other sets of one dataset
    assert days_folder(easy).parent == tmp_path / "freeway"
    assert days_folder(easy.model_copy(update={"seed": 2})) != days_folder(easy)


def test_a_file_without_a_field_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text('kind = "forecast"\nname = "x"')
    with pytest.raises(InvalidInputError, match="description: expected a value, and there is none") as told:
        load_freeway_benchmark(str(tmp_path / "own.toml"))
    assert "\n" not in str(told.value)


def test_unknown_names_get_a_hint() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'forecast-hard'"):
        load_freeway_benchmark("forecast-hrad")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("kind = ", 'network = "a10"\nkind = ', "network: expected 'freeway'"),
        ("start_s = 24300.0", "start_s = 300.0", "start_s: .*720"),
    ],
)
def test_a_morning_that_nobody_can_drive_is_refused(old: str, new: str, said: str, tmp_path: Path) -> None:
    """The controller knows one bottleneck, and its feed begins before the control."""
    whole = benchmark_path("dissipation", Family.FREEWAY).read_text()
    assert old in whole
    (tmp_path / "own.toml").write_text(whole.replace(old, new))
    with pytest.raises(InvalidInputError, match=said):
        load_freeway_benchmark(str(tmp_path / "own.toml"))
