"""Forecasters from outside: what they learn, keep and refuse; the exported ones say the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file

from dohyo.agents.forecasting.base import Forecaster
from dohyo.agents.forecasting.data.windows import Windows, make_windows
from dohyo.agents.forecasting.learned import Learned
from dohyo.agents.forecasting.networks.registry import NETWORKS
from dohyo.agents.forecasting.quantiles import Quantiles, conformal_quantile
from dohyo.agents.forecasting.registry import NAMES, load_forecaster, make_forecaster
from dohyo.agents.forecasting.scores import by_stretch, coverage, errors
from dohyo.agents.forecasting.simple import Linear, Persistence
from dohyo.agents.forecasting.training import TrainSettings
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from tests.agents.forecasting.roads import road_stretch

N = 5
QUICK = TrainSettings(steps=8, validate_every=4, batch=32, depth=1)
torch.set_num_threads(1)


@pytest.fixture(scope="module")
def train() -> Windows:
    return make_windows([road_stretch(200, N, seed, 0.02) for seed in range(3)], 60.0)


@pytest.fixture(scope="module")
def validation() -> Windows:
    return make_windows([road_stretch(200, N, 10, 0.02)], 60.0)


@pytest.fixture(scope="module")
def fitted(train: Windows, validation: Windows) -> dict[str, Forecaster]:
    out = {name: make_forecaster(name, N, 60.0, QUICK) for name in NAMES}
    for one in out.values():
        one.fit(train, validation)
    return out


def history(seed: int = 5, rows: int = 8) -> np.ndarray:
    return road_stretch(200, N, seed).speeds[120 : 120 + rows]


@pytest.mark.parametrize("name", NAMES)
def test_a_forecast_is_three_rows_of_speeds(name: str, fitted: dict[str, Forecaster]) -> None:
    got = fitted[name].predict(history())
    assert got.shape == (3, N)
    assert got.dtype == np.float64
    assert np.isfinite(got).all()
    assert got.min() >= 0.0


@pytest.mark.parametrize("name", NAMES)
def test_a_file_keeps_a_forecaster(name: str, fitted: dict[str, Forecaster], tmp_path: Path) -> None:
    fitted[name].save(tmp_path / "f.safetensors")
    again = load_forecaster(tmp_path / "f.safetensors")
    np.testing.assert_array_equal(again.predict(history(), 8 * 3600.0), fitted[name].predict(history(), 8 * 3600.0))
    assert (again.free_mps, again.step_s) == (fitted[name].free_mps, fitted[name].step_s)


@pytest.mark.parametrize("name", [*NETWORKS, Quantiles.name])
def test_the_exported_network_says_the_same(name: str, fitted: dict[str, Forecaster], tmp_path: Path) -> None:
    one = fitted[name]
    assert isinstance(one, Learned | Quantiles)
    one.export(tmp_path / "f.onnx")
    exported = load_forecaster(tmp_path / "f.onnx")
    for seed in range(5):
        np.testing.assert_allclose(exported.predict(history(seed)), one.predict(history(seed)), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("name", ["sa-lstm", "tsmixer", "linear"])
def test_the_same_seed_gives_the_same_forecaster(
    name: str, train: Windows, validation: Windows, fitted: dict[str, Forecaster]
) -> None:
    again = make_forecaster(name, N, 60.0, QUICK)
    again.fit(train, validation)
    np.testing.assert_array_equal(again.predict(history()), fitted[name].predict(history()))


@pytest.mark.parametrize("name", NAMES)
def test_only_the_last_eight_rows_are_read(name: str, fitted: dict[str, Forecaster]) -> None:
    long = history(rows=20)
    other = long.copy()
    other[:12] = 3.0
    np.testing.assert_array_equal(fitted[name].predict(long), fitted[name].predict(other))


@pytest.mark.parametrize("name", NAMES)
def test_later_rows_change_no_earlier_forecast(name: str, fitted: dict[str, Forecaster]) -> None:
    one = road_stretch(60, N, 7, missing=0.2)
    later = one.speeds.copy()
    later[30:] = 1.0
    both = [make_windows([type(one)("x", 0.0, speeds)], 60.0) for speeds in (one.speeds, later)]
    ahead = [fitted[name].predict_many(some.history, some.time_s)[some.row < 30] for some in both]
    np.testing.assert_allclose(*ahead, atol=1e-4)


def test_training_beats_persistence_on_a_road_with_waves() -> None:
    days = [road_stretch(200, 12, seed, 0.02) for seed in range(14)]
    train, validation, test = (make_windows(some, 60.0) for some in (days[:10], days[10:12], days[12:]))
    now = errors(Persistence(12), test, 31.0).normalised.mean()
    for name in ("sa-lstm", "linear", "tsmixer"):
        one = make_forecaster(name, 12, 60.0, TrainSettings(steps=150, batch=128, depth=None))
        one.fit(train, validation)
        assert errors(one, test, 31.0).normalised.mean() < 0.9 * now, name


def test_the_historical_mean_knows_the_time_of_day(fitted: dict[str, Forecaster], train: Windows) -> None:
    mean = fitted["historical-mean"]
    early, late = mean.predict(history(), 5.1 * 3600.0), mean.predict(history(), 8.0 * 3600.0)
    assert early[:, 0].mean() > late[:, 0].mean() + 1.0, "free at five, a queue at eight"
    quarter = (train.time_s + 60.0) // 900 == 32
    expected = np.nanmean(train.target[quarter, 0], axis=0)
    np.testing.assert_allclose(mean.predict(history(), 8.0 * 3600.0 + 10)[0], expected, rtol=1e-4)


@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_a_linear_road_is_learned_exactly(missing: float) -> None:
    rng = np.random.default_rng(0)
    speeds = np.empty((400, 2), dtype=np.float32)
    speeds[0] = 15.0
    for t in range(1, 400):
        speeds[t] = 15 + 0.8 * (speeds[t - 1, ::-1] - 15) + rng.normal(0, 1.0, 2)  # each follows the other one
    windows = make_windows([type(road_stretch(20, 2))("x", 0.0, speeds)], 60.0)
    known = np.where(rng.random(windows.target.shape) < missing, np.nan, windows.target).astype(np.float32)
    windows = replace(windows, target=known)
    one = Linear(2)
    one.fit(windows, windows)
    got = one.predict(np.vstack([np.full((7, 2), 15.0), [[20.0, 10.0]]]))
    np.testing.assert_allclose(got[0], [11.0, 19.0], atol=0.7)


def test_a_late_feed_is_brought_up_to_now(fitted: dict[str, Forecaster]) -> None:
    one = fitted["sa-lstm-n-step"]
    ahead = one.predict(history())
    np.testing.assert_allclose(one.nowcast(history(), 0.0), history()[-1], rtol=1e-6)
    np.testing.assert_allclose(one.nowcast(history(), 3.0), ahead[2], rtol=1e-6)
    np.testing.assert_allclose(one.nowcast(history(), 1.5), (ahead[0] + ahead[1]) / 2, rtol=1e-6)
    with pytest.raises(InvalidInputError, match="a lag of 0 to 3 minutes, got 4"):
        one.nowcast(history(), 4.0)


def test_missing_values_do_not_stop_a_forecast(fitted: dict[str, Forecaster]) -> None:
    rows = history().copy()
    rows[:, 2] = np.nan
    rows[3:, 0] = np.nan
    assert np.isfinite(fitted["sa-lstm"].predict(rows)).all()


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (np.ones((8, 4)), "at least 8 rows and 5 segments, got 8 x 4"),
        (np.ones((7, N)), "at least 8 rows and 5 segments, got 7 x 5"),
        (np.ones(N), "got 5"),
        (np.full((8, N), -1.0), "speeds of 0 or more"),
        (np.full((8, N), np.inf), "speeds of 0 or more"),
        (np.full((8, N), np.nan), "at least one measured speed"),
    ],
)
def test_a_bad_history_is_refused(rows: np.ndarray, message: str, fitted: dict[str, Forecaster]) -> None:
    with pytest.raises(InvalidInputError, match=message):
        fitted["sa-lstm"].predict(rows)


def test_bad_files_are_one_clear_line(tmp_path: Path, fitted: dict[str, Forecaster]) -> None:
    (tmp_path / "a.safetensors").write_bytes(b"nothing")
    (tmp_path / "a.onnx").write_bytes(b"nothing")
    save_file({"x": np.zeros(1)}, tmp_path / "b.safetensors")
    fitted["sa-lstm"].save(tmp_path / "c.safetensors")
    facts = fitted["sa-lstm"].facts() | {"segments": "6"}
    save_file(fitted["sa-lstm"].tensors(), tmp_path / "d.safetensors", facts)
    cases = {
        "a.safetensors": "is damaged",
        "a.onnx": "is no ONNX model",
        "b.safetensors": "expected the file of a forecaster",
    }
    for name, message in (cases | {"d.safetensors": "expected tensor", "no.onnx": "no forecaster"}).items():
        with pytest.raises(InvalidInputError, match=message):
            load_forecaster(tmp_path / name)
    with pytest.raises(UnknownNameError, match="trained forecaster"):
        load_forecaster("sa-lstm-x")
    with pytest.raises(UnknownNameError, match="forecaster"):
        make_forecaster("arima", N)
    one = fitted["sa-lstm"]
    assert isinstance(one, Learned)
    one.export(tmp_path / "e.onnx")
    exported, few = load_forecaster(tmp_path / "e.onnx"), make_windows([road_stretch(30, N)], 60.0)
    with pytest.raises(InvalidInputError, match="cannot be trained"):
        exported.fit(few, few)


def test_intervals_hold_nine_of_ten_on_days_like_those_of_calibration(train: Windows, validation: Windows) -> None:
    one = Quantiles(N, 60.0, TrainSettings(steps=30, batch=64, depth=None))
    one.fit(train, validation)
    inside, width = coverage(one.intervals_many(validation.history), validation)
    assert (np.abs(inside - 0.9) < 0.01).all(), "on the very days it was calibrated on"
    assert (width > 0.0).all()
    low, middle, high = np.moveaxis(one.predict_interval(history()), 1, 0)
    assert (low <= middle).all()
    assert (middle <= high).all()
    np.testing.assert_allclose(middle, one.predict(history()), rtol=1e-5)


def test_the_conformal_quantile_by_hand() -> None:
    scores = np.arange(1.0, 20.0)  # 19 of them: the ceil(20 x 0.9) = 18th smallest
    assert conformal_quantile(scores, 0.9) == 18.0
    assert conformal_quantile(np.array([3.0, 1.0]), 0.9) == 3.0
    assert conformal_quantile(np.array([]), 0.9) == 0.0


def test_errors_by_hand() -> None:
    windows = make_windows([road_stretch(11, 2, 0), road_stretch(12, 2, 1)], 60.0)
    expected = (windows.history[0, -1] - windows.target[0, 2]) ** 2
    got = errors(Persistence(2), windows, 30.0)
    assert got.squared.shape == (2, 3)
    assert got.squared[0, 2] == pytest.approx(expected.mean(), rel=1e-5)
    assert got.normalised[0, 2] == pytest.approx(1000 * expected.mean() / 900, rel=1e-5)
    per_row = got.squared.mean(axis=0)
    np.testing.assert_allclose(got.rmse("km/h"), 3.6 * np.sqrt(per_row))
    np.testing.assert_allclose(got.rmse("mph") * 1.609344, got.rmse("km/h"))


def test_missing_targets_do_not_count() -> None:
    windows = make_windows([road_stretch(12, 2, 0)], 60.0)
    values = np.ones((2, 3, 2), dtype=np.float32)
    values[0, 0] = np.nan
    values[1, 0] = 5.0
    np.testing.assert_allclose(by_stretch(values, windows), [[5.0, 1.0, 1.0]])
