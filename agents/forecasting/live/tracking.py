"""Intervals that follow what has been measured: both ends move out by every miss, and in by every hit.

Quantile tracking of Angelopoulos, Candes and Tibshirani 2023, "Conformal PID control for time series prediction"; the
size of a step is ours. In the long run 90 % of the values lie inside in any traffic: unlike a calibration, this assumes
no similar days.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from dohyo.agents.forecasting.data.windows import HORIZON, Windows
from dohyo.agents.forecasting.quantiles import COVERAGE
from dohyo.agents.forecasting.scores import coverage
from dohyo.sumo_networks.arrays import Float32Array, FloatArray

RATE: Final = 0.1
"""Size of a step, as a share of the largest recent distance: a miss moves by 0.09 of that, a hit by 0.01."""
LEAST_ERRORS: Final = 30
"""Fewest past errors for an interval."""
MEMORY: Final = 100
"""Forecasts among which the largest recent distance is."""


def tracked(intervals: Float32Array, windows: Windows) -> Float32Array:
    """Intervals (B, 3, 3, N) whose ends follow the values that were known when each forecast was made.

    Args:
        intervals: Row ahead; lower end, middle, upper end; m/s. All three may be the forecast itself.
        windows: What was forecast, in the order of time. The first forecast has the ends of `intervals`.
    """
    lower, middle, upper = np.moveaxis(intervals, 2, 0)
    shift = shifts(np.maximum(lower - windows.target, windows.target - upper), windows)[:-1]
    return np.stack([np.minimum(lower - shift, middle), middle, np.maximum(upper + shift, middle)], axis=2)


def tracked_coverage(ahead: Float32Array, windows: Windows) -> tuple[FloatArray, FloatArray]:
    """Share of values within tracked intervals around forecasts (B, 3, N), (S, 3), and the mean width, (S, 3), m/s.

    The first forecasts, before which there are too few errors for an interval, do not count.
    """
    counted = np.arange(min(LEAST_ERRORS, len(windows)), len(windows))
    return coverage(tracked(np.stack([ahead] * 3, axis=2), windows)[counted], windows.chosen(counted))


def shifts(outside: Float32Array, windows: Windows) -> Float32Array:
    """(B + 1, 3, N) outward shift of both ends at each forecast, and after the last one, m/s.

    Args:
        outside: (B, 3, N) distance of what was measured from the nearer end, m/s; negative inside, NaN where missing.
        windows: What was forecast, in the order of time.
    """
    ahead = [_of_row(outside[:, row], windows, row + 1) for row in range(HORIZON)]
    return np.stack(ahead, axis=1).astype(np.float32)


def _of_row(outside: Float32Array, windows: Windows, ahead: int) -> FloatArray:
    """(B + 1, N) shifts of the forecasts so many rows ahead."""
    size = np.abs(np.nan_to_num(outside))
    made = np.zeros((len(outside) + 1, outside.shape[1]))
    shift, seen = made[0], 0
    for now in range(len(made)):
        while seen < len(outside) and _measured(windows, seen, ahead, now):
            step = RATE * size[max(0, seen - MEMORY + 1) : seen + 1].max(axis=0)
            moved = step * ((outside[seen] > made[seen]) - (1.0 - COVERAGE))
            shift = shift + np.where(np.isfinite(outside[seen]), moved, 0.0)
            seen += 1
        made[now] = shift
    return made


def _measured(windows: Windows, one: int, ahead: int, now: int) -> bool:
    """Whether what one window forecasts so many rows ahead has been measured when another one is forecast."""
    if now == len(windows) or windows.stretch[one] != windows.stretch[now]:
        return True
    return bool(windows.row[one] + ahead <= windows.row[now])
