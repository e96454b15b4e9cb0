"""Intervals that follow what is measured hold 90 % in any traffic, and know nothing of what is to come."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dohyo.agents.forecasting.data.grid import Rows, on_grid
from dohyo.agents.forecasting.data.speed_table import Stretch
from dohyo.agents.forecasting.data.windows import Windows, make_windows
from dohyo.agents.forecasting.live.now import forecast_now
from dohyo.agents.forecasting.live.tracking import LEAST_ERRORS, shifts, tracked, tracked_coverage
from dohyo.agents.forecasting.quantiles import conformal_quantile
from dohyo.agents.forecasting.scores import coverage
from dohyo.agents.forecasting.simple import Persistence
from dohyo.sumo_networks.arrays import Float32Array


def day(noise_mps: list[float], seed: int = 0, missing: float = 0.0) -> Stretch:
    """A day of two segments around 20 m/s, with a deviation at each minute."""
    random = np.random.default_rng(seed)
    speeds = 20.0 + random.normal(size=(len(noise_mps), 2)) * np.array(noise_mps)[:, None]
    speeds[random.random(speeds.shape) < missing] = np.nan
    return Stretch(f"day {seed}", 0.0, speeds.astype(np.float32))


def forecasts(windows: Windows, half_mps: float = 0.0) -> Float32Array:
    """(B, 3, 3, N) intervals around 20 m/s."""
    middle = np.full_like(windows.target, 20.0)
    return np.stack([middle - half_mps, middle, middle + half_mps], axis=2)


@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_nine_of_ten_lie_inside_when_traffic_is_no_longer_that_of_the_calibration(missing: float) -> None:
    windows = make_windows([day([0.5] * 1000 + [4.0] * 1000 + [1.0] * 1000, missing=missing)], 60.0)
    quiet = np.abs(windows.target[:900] - 20.0)
    calibrated = forecasts(windows, conformal_quantile(quiet[np.isfinite(quiet)], 0.9))
    assert (coverage(calibrated, windows)[0] < 0.75).all()
    assert (np.abs(coverage(tracked(calibrated, windows), windows)[0] - 0.9) < 0.015).all()
    assert (np.abs(coverage(tracked(forecasts(windows), windows), windows)[0] - 0.9) < 0.015).all(), "from no width"


@pytest.mark.parametrize("now", [1, 7, 40, 75])
def test_no_interval_knows_of_a_speed_that_is_not_yet_measured(now: int) -> None:
    before, after = (make_windows([day([1.0] * 50, 1), day([2.0] * 60, seed)], 60.0) for seed in (2, 3))
    stretch, row = before.stretch[now], before.row[now]
    both = (before, after)
    for part in both:
        minute = part.row[:, None] + np.arange(1, 4)
        past = (part.stretch[:, None] < stretch) | ((part.stretch[:, None] == stretch) & (minute <= row))
        part.target[~past] = np.random.default_rng(int(part is after)).normal(20.0, 50.0, part.target[~past].shape)
        part.target[past] = before.target[past]
    one, other = (tracked(forecasts(part), part)[now] for part in both)
    np.testing.assert_array_equal(one, other)


def test_what_is_measured_at_last_moves_the_next_interval() -> None:
    windows = make_windows([day([1.0] * 200)], 60.0)
    late = replace(windows, target=windows.target.copy())
    late.target[-1] += 30.0
    one, other = (shifts(np.abs(part.target - 20.0), part) for part in (windows, late))
    np.testing.assert_array_equal(one[:-1], other[:-1])
    assert (other[-1] > one[-1]).all()


def test_ends_stay_on_their_side_of_the_forecast() -> None:
    windows = make_windows([day([0.1] * 300)], 60.0)
    lower, middle, upper = np.moveaxis(tracked(forecasts(windows, 9.0), windows), 2, 0)
    assert (lower <= middle).all()
    assert (middle <= upper).all()
    assert (upper - lower)[-50:].mean() < 2.0, "too wide at first, and narrow in the end"


@pytest.mark.parametrize("minutes", [10 + LEAST_ERRORS, 11 + LEAST_ERRORS, 400])
def test_coverage_is_of_forecasts_that_have_an_interval(minutes: int) -> None:
    windows = make_windows([day([1.0] * minutes)], 60.0)
    inside, width = tracked_coverage(np.full_like(windows.target, 20.0), windows)
    if len(windows) <= LEAST_ERRORS:
        assert inside.shape == width.shape == (0, 3)
    else:
        assert (width > 0.0).all()
    if minutes == 400:
        assert (np.abs(inside - 0.9) < 0.03).all()


def test_intervals_of_now_are_those_whose_coverage_is_counted() -> None:
    """The last error known one row ahead is of the last row, two rows ahead of the same row, and so on."""
    speeds = day([0.5] * 100 + [4.0] * 60, seed=3).speeds
    grid = on_grid([Rows("t", 60.0 * np.arange(160), ("a", "b"), speeds)], None, 0.5, None)
    windows, persistence = make_windows(grid.stretches("t"), 60.0), Persistence(2)
    ahead = persistence.predict_many(windows.history)
    counted = tracked(np.stack([ahead] * 3, axis=2), windows)
    for one in (40, 93, 94, 95, 100, 148):
        rows = int(windows.row[one]) + 1
        now = forecast_now(persistence, replace(grid, place=grid.place[:rows], speeds=grid.speeds[:rows]))
        np.testing.assert_allclose(now.high - now.ahead, counted[one, :, 2] - ahead[one], atol=1e-3)
