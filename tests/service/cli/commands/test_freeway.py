"""`dohyo evaluate` and `dohyo benchmarks list` on the freeway."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest

from dohyo.agents.forecasting import benchmark as benchmarks
from dohyo.evaluation.freeway.benchmark import ForecastBenchmark, days_folder, load_freeway_benchmark
from dohyo.service.cli import main
from tests.agents.forecasting.roads import write_folder

TWO_DAYS = """
kind = "forecast"
name = "two-days"
description = "for tests"
metric = "mse: of two days"
days = "hard"
number = 2
seed = 1
free_kmh = 120.0
"""


def dohyo(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["dohyo", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A benchmark of one's own, whose days are there."""
    monkeypatch.setenv("DOHYO_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(benchmarks, "TIMED", 2)
    monkeypatch.setattr(benchmarks, "WARM_UPS", 1)
    path = tmp_path / "two-days.toml"
    path.write_text(TWO_DAYS)
    benchmark = load_freeway_benchmark(str(path))
    assert isinstance(benchmark, ForecastBenchmark)
    shutil.copytree(write_folder(tmp_path / "made", rows=60), days_folder(benchmark))
    (days_folder(benchmark) / "dataset.json").unlink()  # what is made later says what it is
    return path


def test_a_forecaster_is_evaluated_and_its_result_written(
    own: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    order = ("evaluate", "--benchmark", str(own), "--agent", "linear", "--out", str(out))
    assert dohyo(monkeypatch, *order) == 0
    told = capsys.readouterr().out
    assert "persistence" in told
    assert f"report: {(out / 'report.html').resolve()}" in told.splitlines()
    assert dohyo(monkeypatch, *order, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads((out / "result.json").read_text())
    assert document["scores"]["mse"]["agent"]["n"] == 2
    assert "linear" in (out / "report.html").read_text()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--agent", "linear", "--seeds", "0"), "has fixed days"),
        (("--agent", "linear", "--executor", "ray"), "--executor: expected a benchmark of driving agents"),
        (("--agent", "linear", "--reverse"), "--reverse: expected a benchmark of driving agents"),
        (("--agent", "linear", "--set", "depth=3"), "unknown (its settings are exported)"),
        (("--agent", "autopilot"), "no trained forecaster named 'autopilot'"),
    ],
)
def test_mistakes_are_told_in_one_line_and_leave_nothing(
    own: Path,
    options: tuple[str, ...],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert dohyo(monkeypatch, "evaluate", "--benchmark", str(own), *options, "--out", str(tmp_path / "out")) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_days_are_prepared(own: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert dohyo(monkeypatch, "benchmarks", "prepare", str(own)) == 0
    assert "0 made, 2 kept" in capsys.readouterr().out
    assert dohyo(monkeypatch, "benchmarks", "prepare", "dissipation") == 2
    assert "has nothing to prepare" in capsys.readouterr().err


def test_they_are_listed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert dohyo(monkeypatch, "benchmarks", "list", "--json") == 0
    listed = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert listed["forecast-hard"]["scenarios"] == 4
    assert listed["forecast-hard"]["metric"].startswith("mse:")
    assert listed["dissipation"]["version"] == load_freeway_benchmark("dissipation").sha256[:12]
