"""The benchmark `dissipation`: which arm a controller is, and two short mornings from end to end."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from dohyo.agents.speed_planning import acc, benchmark, buffer
from dohyo.agents.speed_planning.benchmark import controller, evaluate_controller, morning_of, untouched_folder
from dohyo.agents.speed_planning.study.dissipation import Morning
from dohyo.agents.studies.study import ROWS
from dohyo.evaluation.freeway.benchmark import TrafficBenchmark, load_freeway_benchmark
from dohyo.evaluation.freeway.result import RESULT
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError


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


@pytest.mark.parametrize(
    ("settings", "used", "unused"),
    [
        ({"design": "learned", "forecast": "persistence"}, buffer, acc),
        ({"forecast": "persistence", "set_points": "learned"}, acc, buffer),
    ],
)
def test_mornings_of_other_weights_lie_in_another_folder(
    settings: dict[str, Any],
    used: ModuleType,
    unused: ModuleType,
    dissipation: TrafficBenchmark,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folders: list[Path] = []

    def driven(folder: Path, arm: str, *_: object) -> None:
        folders.append(folder)
        if arm != benchmark.NOBODY:
            raise SimulationError("enough")

    def replaced(module: ModuleType) -> None:
        retrained, weights = tmp_path / module.CHECKPOINT.name, bytearray(module.CHECKPOINT.read_bytes())
        weights[-4] ^= 1  # the last bit of a number
        retrained.write_bytes(weights)
        monkeypatch.setattr(module, "CHECKPOINT", retrained)

    monkeypatch.setattr(benchmark, "_drive", driven)
    for module in (None, unused, used):
        if module is not None:
            replaced(module)
        with pytest.raises(SimulationError, match="enough"):
            evaluate_controller(dissipation, "speed-planner", settings, [0], tmp_path / "out")
    _, first, _, same, _, other = folders
    assert first == same, "weights that it does not use"
    assert first != other


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
