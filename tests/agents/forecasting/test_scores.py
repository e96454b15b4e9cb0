"""Scores where something is missing: a stretch without a value counts in no mean, and changes no other one."""

from __future__ import annotations

import json
import warnings
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from dohyo.agents.forecasting.data.reading import read_latest
from dohyo.agents.forecasting.data.speed_table import Stretch
from dohyo.agents.forecasting.data.windows import make_windows
from dohyo.agents.forecasting.live.now import forecast_now
from dohyo.agents.forecasting.scores import by_stretch, errors
from dohyo.agents.forecasting.simple import Persistence
from dohyo.service.cli import app
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.forecasting.roads import road_speeds, road_stretch, write_csv


class SilentWhenSlow(Persistence):
    """Persistence that gives NaN where a forecast is likely to be wrong."""

    def predict_many(self, histories: Float32Array, time_s: FloatArray | None = None) -> Float32Array:
        ahead = super().predict_many(histories, time_s)
        return np.where(ahead < 20.0, np.float32(np.nan), ahead)


DAYS = [road_stretch(40, 4, seed, missing=0.1) for seed in range(5)]


def silent_at_the_end() -> Stretch:
    """A day of one window, without a value two and three rows ahead."""
    speeds = road_speeds(11, 4, 9).astype(np.float32)
    speeds[9:] = np.nan
    return Stretch("short", 0.0, speeds)


def test_a_stretch_without_a_value_counts_in_no_mean() -> None:
    persistence = Persistence(4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with_it, without = (
            errors(persistence, make_windows(days, 60.0), 30.0) for days in ([*DAYS, silent_at_the_end()], DAYS)
        )
        assert np.isnan(with_it.squared[-1]).tolist() == [False, True, True]
        np.testing.assert_array_equal(with_it.rmse("km/h")[1:], without.rmse("km/h")[1:])
        np.testing.assert_array_equal(with_it.mse_x1000()[1:], without.mse_x1000()[1:])
        np.testing.assert_array_equal(with_it.rmse_interval("km/h")[1:], without.rmse_interval("km/h")[1:])
    assert with_it.rmse("km/h")[0] != without.rmse("km/h")[0]


def test_means_of_whole_stretches_have_the_bits_of_numpys() -> None:
    windows = make_windows(DAYS, 60.0)
    values = (windows.history[:, -3:] - windows.target) ** 2
    expected = [np.nanmean(values[windows.stretch == day].astype(np.float64), axis=(0, 2)) for day in range(5)]
    np.testing.assert_array_equal(by_stretch(values, windows), expected)
    got = errors(Persistence(4), windows, 30.0)
    np.testing.assert_array_equal(got.mse_x1000(), got.normalised.mean(axis=0))


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_table_whose_last_day_ends_in_silence_is_evaluated(tmp_path: Path) -> None:
    table, random = tmp_path / "t.csv", np.random.default_rng(0)
    times = [datetime(2026, 3, 2) + timedelta(minutes=15 * step) for step in range(10 * 96 + 12)]
    rows = ["time,speed", *(f"{at},{random.normal(90, 9):.1f}" for at in times[:-3]), f"{times[-1]},"]
    table.write_text("\n".join(rows) + "\n")
    words = ("forecast", "evaluate", "--data", str(table), "--unit", "km/h", "--model", "persistence", "--json")
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    test = json.loads(result.stdout)["sets"]["test"]
    assert test["stretches"] == 2, "the last one has no value two rows ahead"
    assert all(np.isfinite(test["persistence"]["rmse_kmh"]))


def test_a_forecast_that_is_not_finite_is_no_missing_speed(tmp_path: Path) -> None:
    speeds = np.where(np.arange(200) < 150, 30.0, 10.0)[:, None] + np.random.default_rng(0).normal(size=(200, 1))
    windows = make_windows([Stretch("d", 0.0, speeds.astype(np.float32))], 60.0)
    with pytest.raises(InvalidInputError, match=r"expected finite speeds of the forecaster, got nan in \d+ of 190"):
        errors(SilentWhenSlow(1), windows, 30.0)
    fast = np.full((8, 1), 30.0)
    for rows in (speeds, np.concatenate([speeds, fast])):  # the present forecast too, or past ones alone
        table = write_csv(tmp_path / "t.csv", rows)
        with pytest.raises(InvalidInputError, match="expected finite speeds of the forecaster, got nan in"):
            forecast_now(SilentWhenSlow(1), read_latest(table))
