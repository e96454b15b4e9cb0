"""Localization scores: errors of an estimated track against the true one. Pure functions of both tracks.

All functions take the estimated and the true positions of one drive at the same times, (N, 2), m.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError

WITHIN_M: Final = 0.5
"""Largest error of a sample that the thesis counts as correct, m."""


def errors(estimated: FloatArray, true: FloatArray) -> FloatArray:
    """(N,) distance of every sample from the true position, m.

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
    """Percentage of the samples within a distance of the true position. Source: Albilani's thesis, 4.3.2.4."""
    return 100.0 * float(np.mean(errors(estimated, true) <= within_m))


def rmse(estimated: FloatArray, true: FloatArray) -> float:
    """Root mean square of the distances, m."""
    return float(np.sqrt(np.mean(errors(estimated, true) ** 2)))


def p95(estimated: FloatArray, true: FloatArray) -> float:
    """95th percentile of the distances, m."""
    return float(np.quantile(errors(estimated, true), 0.95))


def max_drift(estimated: FloatArray, true: FloatArray) -> float:
    """Largest of the distances, m."""
    return float(errors(estimated, true).max())
