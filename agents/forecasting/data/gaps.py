"""Gaps: replacement of missing speeds from the past alone.

The rule has a name, `hold-neighbour`: a missing value is the last earlier one of its segment within the history; before
the first, that first one; and a segment without values in the whole history is interpolated between the nearest
segments with values. Only the history is used, so nothing of the future enters.
"""

from __future__ import annotations

import numpy as np

from dohyo.sumo_networks.arrays import BoolArray, Float32Array
from dohyo.sumo_networks.errors import InvalidInputError

RULE = "hold-neighbour"


def fillable(histories: Float32Array) -> BoolArray:
    """(B,) whether histories (B, s, N) have at least one value."""
    return np.asarray(np.isfinite(histories).any(axis=(1, 2)))


def fill(histories: Float32Array) -> Float32Array:
    """Histories without gaps.

    Args:
        histories: (B, s, N) speeds, NaN where missing.

    Raises:
        InvalidInputError: A history has no value at all.
    """
    if not fillable(histories).all():
        raise InvalidInputError("expected at least one measured speed in a history, got only missing ones")
    if np.isfinite(histories).all():
        return histories
    held = _hold(_hold(histories)[:, ::-1])[:, ::-1]
    silent = np.isnan(held[:, 0])  # after holding in both directions, a segment has all values or none
    for one in np.flatnonzero(silent.any(axis=1)):
        known = np.flatnonzero(~silent[one])
        for segment in np.flatnonzero(silent[one]).tolist():
            held[one, :, segment] = _between(held[one], segment, known)
    return np.ascontiguousarray(held)


def _hold(histories: Float32Array) -> Float32Array:
    """Each missing value replaced by the last one before it, along the second axis."""
    rows = np.where(np.isnan(histories), 0, np.arange(histories.shape[1])[None, :, None])
    return np.take_along_axis(histories, np.maximum.accumulate(rows, axis=1), axis=1)


def _between(history: Float32Array, segment: int, known: np.typing.NDArray[np.intp]) -> Float32Array:
    """(s,) the line between the nearest known segments; beyond the ends, the nearest one."""
    place = int(np.searchsorted(known, segment))
    left, right = known[max(place - 1, 0)], known[min(place, len(known) - 1)]
    share = 0.5 if left == right else (segment - left) / (right - left)
    out: Float32Array = (1 - share) * history[:, left] + share * history[:, right]
    return out
