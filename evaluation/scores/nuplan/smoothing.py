"""Savitzky-Golay: derivatives of a sampled signal, by a polynomial fitted around each sample."""

from __future__ import annotations

from functools import lru_cache
from math import factorial

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError


def savitzky_golay(values: FloatArray, window: int, order: int, derivative: int, step: float) -> FloatArray:
    """The signal, or a derivative of it, smoothed without delay.

    The window is odd, since an even one lags by half a sample. Near the ends, and for signals shorter than the window,
    the polynomial is that of the nearest whole window.

    Args:
        values: (N,) samples at equal distances.
        window: Number of samples fitted, odd.
        order: Of the polynomial, below the window.
        derivative: 0 for the signal itself.
        step: Between two samples.

    Returns:
        (N,); zeros where there are too few samples for the polynomial.

    Raises:
        InvalidInputError: An even window, or an order that it does not determine.

    Source: Savitzky and Golay 1964.
    """
    if window % 2 == 0 or not 0 <= derivative <= order < window:
        raise InvalidInputError(
            f"expected an odd window above the order, got window {window}, order {order}, derivative {derivative}"
        )
    count = len(values)
    window = min(window, count if count % 2 else count - 1)
    if window <= order:
        return np.zeros(count) if derivative else values.astype(np.float64)
    half = window // 2
    weights = _weights(window, order, derivative) / step**derivative
    out = np.empty(count)
    out[half : count - half] = np.lib.stride_tricks.sliding_window_view(values, window) @ weights[half]
    out[:half] = weights[:half] @ values[:window]
    out[count - half :] = weights[half + 1 :] @ values[-window:]
    return out


@lru_cache(maxsize=32)
def _weights(window: int, order: int, derivative: int) -> FloatArray:
    """(W, W) weights of the samples of one window, one row for each place in it at which to evaluate."""
    places = np.arange(window) - window // 2
    fit = np.linalg.pinv(np.vander(places, order + 1, increasing=True).astype(np.float64))  # (order + 1, W)
    powers = np.arange(derivative, order + 1)
    slopes = np.array([factorial(p) / factorial(p - derivative) for p in powers])
    evaluate = places[:, None].astype(np.float64) ** (powers - derivative) * slopes
    return np.asarray(evaluate @ fit[derivative:])
