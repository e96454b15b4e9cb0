"""Scores of forecasts: squared errors on normalised speed, errors in km/h and mph, coverage; per stretch and row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dohyo.agents.forecasting.base import Forecaster
from dohyo.agents.forecasting.data.speed_table import UNITS
from dohyo.agents.forecasting.data.windows import HORIZON, Windows
from dohyo.agents.forecasting.frontiers import Frontiers, congested, frontiers, known
from dohyo.evaluation.statistics import mean_estimate
from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray
from dohyo.sumo_networks.errors import InvalidInputError


@dataclass(frozen=True)
class Errors:
    """Mean squared errors of one forecaster, by stretch and row ahead; one stretch is mostly one day.

    Attributes:
        squared: (S, 3) m^2/s^2 against what was measured; NaN where a stretch has no value, which no mean counts.
        squared_true: (S, 3) the same against all vehicles; None if that is not known.
        free_mps: Speed with the normalised value 1.
    """

    squared: FloatArray
    squared_true: FloatArray | None
    free_mps: float

    @property
    def normalised(self) -> FloatArray:
        """(S, 3) the mean squared error of normalised speed, x 10^3."""
        return 1e3 * self.squared / self.free_mps**2

    def mse_x1000(self) -> FloatArray:
        """(3,) mean of `normalised` over stretches."""
        return _known_mean(self.normalised, 0)

    def rmse(self, unit: str) -> FloatArray:
        """(3,) root of the mean over stretches, in a unit of `data.UNITS`."""
        return np.asarray(np.sqrt(_known_mean(self.squared, 0)) / UNITS[unit])

    def rmse_interval(self, unit: str) -> FloatArray:
        """(3, 2) 95 % interval of `rmse` over stretches; NaN with fewer than two."""
        ends = [mean_estimate(values[~np.isnan(values)].tolist()) for values in self.squared.T]
        known = [[np.nan if end is None else end for end in (one.low, one.high)] for one in ends]
        return np.asarray(np.sqrt(np.array(known, dtype=np.float64)) / UNITS[unit])


def errors(forecaster: Forecaster, windows: Windows, free_mps: float) -> Errors:
    """The errors of one forecaster on the windows of a set."""
    return errors_of(forecaster.predict_many(windows.history, windows.time_s), windows, free_mps)


def errors_of(ahead: Float32Array, windows: Windows, free_mps: float) -> Errors:
    """The errors of forecasts (B, 3, N), m/s, one for each window.

    Raises:
        InvalidInputError: A forecast is not finite.
    """
    check_finite(ahead)
    squared = by_stretch((ahead - windows.target) ** 2, windows)
    true = None if windows.truth is None else by_stretch((ahead - windows.truth) ** 2, windows)
    return Errors(squared, true, free_mps)


def check_finite(ahead: Float32Array | FloatArray) -> None:
    """Refuses forecasts (B, 3, N) that are not finite: means leave NaN out, as a speed that was not measured.

    Raises:
        InvalidInputError: See above.
    """
    wrong = ~np.isfinite(ahead)
    if wrong.any():
        raise InvalidInputError(
            f"expected finite speeds of the forecaster, got {ahead[wrong][0]:g} in "
            f"{int(wrong.any(axis=(1, 2)).sum())} of {len(ahead)} forecasts"
        )


def by_stretch(values: Float32Array, windows: Windows) -> FloatArray:
    """(S, 3) means of values (B, 3, N) over the windows and segments of each stretch; missing ones do not count.

    NaN where a stretch has no value so many rows ahead, such as one that is eleven rows long and ends in missing ones.
    """
    numbers = np.unique(windows.stretch)
    return np.array(
        [_known_mean(values[windows.stretch == one].astype(np.float64), (0, 2)) for one in numbers]
    ).reshape(len(numbers), HORIZON)


def _known_mean(values: FloatArray, axes: int | tuple[int, ...]) -> FloatArray:
    """Mean along axes of the values that are known; NaN where there is none, without the warning of `np.nanmean`."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.nansum(values, axis=axes) / np.sum(~np.isnan(values), axis=axes))


def frontiers_ahead(forecaster: Forecaster, windows: Windows, free_mps: float) -> BoolArray:
    """(B, 3, N) frontiers that a forecaster expects: its own, or those of the speeds that it forecasts."""
    if isinstance(forecaster, Frontiers):
        return np.asarray(forecaster.probabilities(windows.history) > 0.5)
    return frontiers(congested(forecaster.predict_many(windows.history, windows.time_s), free_mps))


def frontier_scores(expected: BoolArray, windows: Windows, free_mps: float) -> dict[str, FloatArray]:
    """Precision, recall and F1 of expected frontiers (B, 3, N), each (S, 3), %; NaN where there are none."""
    there, true = known(windows.target), frontiers(congested(windows.target, free_mps))
    hits, expected_ones, true_ones = (
        np.array([(some & there)[windows.stretch == one].sum(axis=(0, 2)) for one in np.unique(windows.stretch)], float)
        for some in (expected & true, expected, true)
    )
    with np.errstate(invalid="ignore"):
        found = {
            "precision": hits / expected_ones,
            "recall": hits / true_ones,
            "f1": 2.0 * hits / (expected_ones + true_ones),
        }
    return {f"frontier_{name}": 100.0 * table for name, table in found.items()}


def coverage(intervals: Float32Array, windows: Windows) -> tuple[FloatArray, FloatArray]:
    """Share of values within intervals (B, 3, 3, N), (S, 3), and the mean width, (S, 3), m/s."""
    inside = (windows.target >= intervals[:, :, 0]) & (windows.target <= intervals[:, :, 2])
    counted = np.where(np.isfinite(windows.target), inside, np.nan).astype(np.float32)
    return by_stretch(counted, windows), by_stretch(intervals[:, :, 2] - intervals[:, :, 0], windows)
