"""Localization scores: how far an estimated track is from the true one. Pure functions of the two.

All take the estimated and the true positions at the same times, (N, 2), m, of one drive.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError

WITHIN_M: Final = 0.5
"""The distance within which the thesis counts a sample as right."""


def errors(estimated: FloatArray, true: FloatArray) -> FloatArray:
    """(N,) distance of every sample from the truth, m.

    Raises:
        InvalidInputError: The shapes differ, there is no sample, or one is not finite.
    """
    if estimated.shape != true.shape or estimated.ndim != 2 or estimated.shape[1] != 2 or not len(estimated):
        raise InvalidInputError(
            f"expected two tracks of equal length, (N, 2) with N > 0, got {estimated.shape}, {true.shape}"
        )
    if not (np.isfinite(estimated).all() and np.isfinite(true).all()):
        raise InvalidInputError("expected finite positions, got NaN or infinity")
    return np.asarray(np.hypot(*(estimated - true).T))


def accuracy(estimated: FloatArray, true: FloatArray, within_m: float = WITHIN_M) -> float:
    """Per cent of the samples within a distance of the truth. Source: Albilani's thesis, 4.3.2.4."""
    return 100.0 * float(np.mean(errors(estimated, true) <= within_m))


def rmse(estimated: FloatArray, true: FloatArray) -> float:
    """Root of the mean squared distance, m."""
    return float(np.sqrt(np.mean(errors(estimated, true) ** 2)))


def p95(estimated: FloatArray, true: FloatArray) -> float:
    """Distance that 95 % of the samples keep within, m."""
    return float(np.quantile(errors(estimated, true), 0.95))


def max_drift(estimated: FloatArray, true: FloatArray) -> float:
    """Largest distance, m."""
    return float(errors(estimated, true).max())
