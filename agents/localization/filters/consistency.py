"""Consistency: whether a filter's covariance fits its errors. NEES against the truth, NIS against the fixes.

Source: Bar-Shalom, Li and Kirubarajan 2001, 5.4.
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri  # type: ignore[import-untyped]

from dohyo.sumo_networks.arrays import FloatArray


def nees(error: FloatArray, covariance: FloatArray) -> float:
    """Normalised estimation error squared: the error in units of its covariance.

    Args:
        error: (d,).
        covariance: (d, d) of the filter.

    Returns:
        Chi-square of d degrees of freedom if the filter is right; above d where it is overconfident.
    """
    return float(error @ np.linalg.solve(covariance, error))


def mean_bounds(dimension: int, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of the mean of independent NEES or NIS of one dimension, if the filter is right."""
    degrees, tail = dimension * runs, 0.5 * (1.0 - confidence)
    return float(chdtri(degrees, 1.0 - tail)) / runs, float(chdtri(degrees, tail)) / runs


def quantile(dimension: int, probability: float) -> float:
    """Quantile of one NEES or NIS, if the filter is right."""
    return float(chdtri(dimension, 1.0 - probability))
