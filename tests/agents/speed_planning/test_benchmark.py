"""The benchmark `dissipation`: which arm a controller is, and two short mornings from end to end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from dohyo.agents.speed_planning.benchmark import controller, evaluate_controller, morning_of, untouched_folder
from dohyo.agents.speed_planning.study.dissipation import Morning
from dohyo.agents.studies.study import ROWS
from dohyo.evaluation.freeway.benchmark import TrafficBenchmark, load_freeway_benchmark
from dohyo.evaluation.freeway.result import RESULT
from dohyo.sumo_networks.errors import InvalidInputError


@pytest.fixture
def dissipation() -> TrafficBenchmark:
    benchmark = load_freeway_benchmark("dissipation")
    assert isinstance(benchmark, TrafficBenchmark)
    return benchmark


def test_the_file_and_the_study_are_of_the_same_morning(dissipation: TrafficBenchmark) -> None:
    assert morning_of(dissipation) == Morning()


@pytest.mark.parametrize(
    ("name", "settings", "arm"),
    [
        ("none", {}, "none"),
        ("speed-planner", {}, "limit+sa-lstm"),
        ("speed-planner", {"design": "rule", "forecast": "oracle"}, "rule+oracle"),
        ("speed-planner", {"design": "none"}, "none"),
    ],
)
def test_settings_choose_the_arm(dissipation: TrafficBenchmark, name: str, settings: dict[str, Any], arm: str) -> None:
    assert controller(dissipation, name, settings)[0] == arm


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("speed-plannr", {}, "did you mean 'speed-planner'"),
        ("speed-planner", {"designs": "rule"}, "'designs': unknown, did you mean 'design'"),
        ("speed-planner", {"design": "rul"}, "did you mean 'rule"),
        ("speed-planner", {"set_points": "nobody"}, "expected one of 'none', 'plan', 'learned', got 'nobody'"),
        ("speed-planner", {"forecaster": "none.onnx"}, "no forecaster 'none.onnx'"),
        ("none", {"design": "rule"}, "'design': unknown"),
    ],
)
def test_mistakes_are_told_before_anything_is_driven(
    dissipation: TrafficBenchmark, tmp_path: Path, name: str, settings: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidInputError, match=message):
        evaluate_controller(dissipation, name, settings, [0], tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_night_with_hardly_anybody(
    dissipation: TrafficBenchmark, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DOHYO_HOME", str(tmp_path / "home"))
    night = dissipation.model_copy(update={"start_s": 7200.0, "duration_s": 60.0, "warm_up_s": 60.0})
    settings = {"forecast": "persistence"}
    told: list[tuple[int, int]] = []
    got = evaluate_controller(
        night, "speed-planner", settings, [0], tmp_path / "out", 2, lambda done, of, _: told.append((done, of))
    )
    assert [*got.units] == ["seed-000"]
    assert got.units["seed-000"]["speed_mps"] > 20.0
    assert told[0] == (0, 2)
    assert told[-1] == (2, 2)
    kept = untouched_folder(night, got.versions) / ROWS
    driven = kept.read_text()
    assert (tmp_path / "out" / RESULT).exists()
    again = evaluate_controller(night, "speed-planner", settings, [0], tmp_path / "out")
    assert again.record_hash == got.record_hash
    (folder,) = (tmp_path / "out" / "runs").iterdir()
    (tmp_path / "out" / RESULT).unlink()  # as if it had been interrupted
    evaluate_controller(night, "speed-planner", settings | {"set_points": "plan"}, [0], tmp_path / "out")
    other = {path for path in (tmp_path / "out" / "runs").iterdir() if path != folder}
    assert len(other) == 1, "other settings have mornings of their own"
    nobody = evaluate_controller(night, "none", {}, [0], tmp_path / "nobody")
    assert nobody.units == got.reference_units
    assert kept.read_text() == driven  # driven once for all results
