"""The forecast benchmarks, on hand-made days that lie where a benchmark keeps its own."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dohyo.agents.forecasting import benchmark as benchmarks
from dohyo.agents.forecasting.base import Forecaster, Progress
from dohyo.agents.forecasting.benchmark import benchmark_windows, evaluate_forecaster
from dohyo.agents.forecasting.data.windows import Windows
from dohyo.evaluation.freeway.benchmark import ForecastBenchmark, days_folder, load_freeway_benchmark
from dohyo.evaluation.freeway.result import RESULT
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.forecasting.roads import write_folder

NAME = "tests.agents.forecasting.test_benchmark"


class Late(Forecaster):
    """Says that each segment will be as fast as it was, and some m/s faster."""

    name = "late"

    def __init__(self, segments: int, step_s: float, faster_mps: float = 0.0) -> None:
        super().__init__(segments, step_s)
        self.faster_mps = faster_mps

    def predict_many(self, histories: Float32Array, time_s: FloatArray | None = None) -> Float32Array:
        return np.repeat(histories[:, -1:] + np.float32(self.faster_mps), 3, axis=1)

    def learn(self, train: Windows, validation: Windows, progress: Progress | None) -> None: ...

    def tensors(self) -> dict[str, np.ndarray]:
        return {}

    def restore(self, tensors: Any) -> None: ...


@pytest.fixture
def hard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ForecastBenchmark:
    monkeypatch.setenv("DOHYO_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(benchmarks, "TIMED", 2)
    monkeypatch.setattr(benchmarks, "WARM_UPS", 1)
    benchmark = load_freeway_benchmark("forecast-hard")
    assert isinstance(benchmark, ForecastBenchmark)
    shutil.copytree(write_folder(tmp_path / "made", rows=60), days_folder(benchmark))
    (days_folder(benchmark) / "dataset.json").unlink()  # what is made later says what it is
    return benchmark.model_copy(update={"number": 2})


def test_persistence_beside_itself(hard: ForecastBenchmark, tmp_path: Path) -> None:
    got = evaluate_forecaster(hard, "persistence", {}, tmp_path / "out")
    assert got.units == got.reference_units
    assert [*got.units] == ["hard/day-0001", "hard/day-0002"]
    windows, _ = benchmark_windows(hard)
    one = windows.stretch == 0
    ahead = np.repeat(windows.history[one][:, -1:], 3, axis=1)
    mse = np.nanmean((ahead - windows.target[one]).astype(np.float64) ** 2, axis=(0, 2))
    free_mps = hard.free_kmh / 3.6
    assert got.units["hard/day-0001"]["mse_2"] == pytest.approx(1e3 * mse[1] / free_mps**2, rel=1e-4)
    assert got.estimates["rmse_3"].mean is not None
    assert (tmp_path / "out" / RESULT).exists()


def test_a_class_of_ones_own(hard: ForecastBenchmark, tmp_path: Path) -> None:
    same = evaluate_forecaster(hard, f"{NAME}:Late", {}, tmp_path / "same")
    assert same.units == same.reference_units
    worse = evaluate_forecaster(hard, f"{NAME}:Late", {"faster_mps": 9.0}, tmp_path / "worse")
    found = worse.comparisons["mse"]
    assert (found.probability, found.verdict) == (None, "="), "two days show nothing"
    assert worse.agent.sha256 == same.agent.sha256
    assert worse.record_hash != same.record_hash


def test_the_same_again_gives_the_same(hard: ForecastBenchmark, tmp_path: Path) -> None:
    first = evaluate_forecaster(hard, "linear", {}, tmp_path / "out")
    again = evaluate_forecaster(hard, "linear", {}, tmp_path / "out")
    assert first.record_hash == again.record_hash
    onnx = evaluate_forecaster(hard, "tsmixer", {"exported": True}, tmp_path / "onnx")
    torch = evaluate_forecaster(hard, "tsmixer", {}, tmp_path / "torch")
    assert onnx.estimates["mse"].mean == pytest.approx(torch.estimates["mse"].mean, rel=1e-4)


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("sa-lstm-n-stp", {}, "did you mean 'sa-lstm-n-step'"),
        ("linear", {"depth": 3}, "'depth': unknown .its settings are exported"),
        ("nowhere:Late", {}, "module 'nowhere' cannot be imported: ModuleNotFoundError"),
        (f"{NAME}:Path", {}, "expected a forecaster|cannot be made"),
        ("none.onnx", {}, "no forecaster 'none.onnx'"),
    ],
)
def test_mistakes_cost_nothing(
    hard: ForecastBenchmark, tmp_path: Path, name: str, settings: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidInputError, match=message):
        evaluate_forecaster(hard, name, settings, tmp_path / "out")
    assert not (tmp_path / "out").exists()
