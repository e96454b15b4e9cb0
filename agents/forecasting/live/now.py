"""Forecast now: the next rows after the last one of a table that grows, with intervals that follow its past errors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dohyo.agents.forecasting.base import Forecaster
from dohyo.agents.forecasting.data.grid import Grid
from dohyo.agents.forecasting.data.speed_table import DAY_S, Stretch
from dohyo.agents.forecasting.data.windows import HISTORY, HORIZON, make_windows
from dohyo.agents.forecasting.live.tracking import LEAST_ERRORS, shifts
from dohyo.agents.forecasting.scores import check_finite
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.errors import InvalidInputError

MOST_WINDOWS = 2000
"""Number of the latest windows whose errors give the intervals."""


@dataclass(frozen=True)
class Forecast:
    """Speeds of the next three steps.

    Attributes:
        made_s: Time of the last row.
        step_s: Seconds between two rows.
        segments: Names of the N columns.
        latest: (N,) speeds of the last row, m/s, NaN where missing.
        ahead: (3, N), m/s.
        low: (3, N) lower end of the 90 % interval; NaN where there are too few past errors.
        high: (3, N) upper end.
        windows: Number of past forecasts whose errors the interval is of.
        offset_s: How far the table's clock is ahead of UTC; None: times without a zone.
    """

    made_s: float
    step_s: float
    segments: tuple[str, ...]
    latest: Float32Array
    ahead: FloatArray
    low: FloatArray
    high: FloatArray
    windows: int
    offset_s: float | None

    @property
    def times_s(self) -> FloatArray:
        """(3,) times of the forecast rows."""
        return np.asarray(self.made_s + self.step_s * np.arange(1.0, HORIZON + 1.0))


def forecast_now(forecaster: Forecaster, grid: Grid) -> Forecast:
    """Forecast after the last row.

    Args:
        forecaster: Trained, for such a table.
        grid: The table.

    Raises:
        InvalidInputError: The table has too few rows, nothing was measured in the last eight, or a forecast is not
            finite, this one or one of past rows.
    """
    history = latest_steps(grid, HISTORY)
    ahead = forecaster.predict(history, grid.last_s % DAY_S)
    check_finite(ahead[None])
    errors, windows = past_errors(forecaster, grid)
    return Forecast(
        made_s=grid.last_s,
        step_s=grid.step_s,
        segments=grid.names,
        latest=history[-1],
        ahead=ahead,
        low=np.maximum(ahead - errors, 0.0),
        high=ahead + errors,
        windows=windows,
        offset_s=grid.offset_s,
    )


def latest_steps(grid: Grid, steps: int) -> Float32Array:
    """(steps, N) the last steps up to the last row, NaN where nothing was measured.

    Raises:
        InvalidInputError: The table covers fewer steps, or nothing was measured in these.
    """
    first = grid.place[-1] - steps + 1
    if first < grid.place[0]:
        raise InvalidInputError(f"expected a table of at least {steps} steps, got {grid.steps}")
    out = np.full((steps, grid.speeds.shape[1]), np.nan, dtype=np.float32)
    rows = grid.place >= first
    out[grid.place[rows] - first] = grid.speeds[rows]
    if not np.isfinite(out).any():
        raise InvalidInputError(f"expected a speed in the last {steps} steps, got none")
    return out


def past_errors(forecaster: Forecaster, grid: Grid) -> tuple[FloatArray, int]:
    """(3, N) half widths of the intervals, m/s, and the number of past forecasts whose errors they follow.

    See `tracking`. NaN where there are too few errors. Past rows that the forecaster was trained on
    make them too small.

    Raises:
        InvalidInputError: A forecast is not finite.
    """
    none = np.full((HORIZON, len(grid.names)), np.nan)
    *before, last = grid.stretches("past")
    try:
        windows = make_windows([*before, _open_end(last)], grid.step_s)
    except InvalidInputError:
        return none, 0
    windows = windows.chosen(np.arange(max(0, len(windows) - MOST_WINDOWS), len(windows)))
    ahead = forecaster.predict_many(windows.history, windows.time_s)
    check_finite(ahead)
    off = np.abs(ahead - windows.target)
    enough = np.isfinite(off).sum(axis=0) >= LEAST_ERRORS
    return np.where(enough, np.maximum(shifts(off, windows)[-1], 0.0), none), len(windows)


def _open_end(one: Stretch) -> Stretch:
    """A stretch with rows to come, so that windows of which only the first target rows are known count too."""
    to_come = np.full((HORIZON - 1, one.speeds.shape[1]), np.nan, dtype=np.float32)
    return replace(one, speeds=np.concatenate([one.speeds, to_come]), truth=None)
