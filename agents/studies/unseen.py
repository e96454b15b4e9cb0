"""Unseen: towns and conditions of NoCrash that a training saw or not, and the gap of success between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from dohyo.evaluation.statistics import N_RESAMPLES, SEED, Estimate, share_estimate

SEEN: Final = "train"
PLACES: Final = {
    "both seen": (True, True),
    "unseen conditions": (True, False),
    "unseen town": (False, True),
    "both unseen": (False, False),
}
"""Whether the town and the conditions are those of the training."""


def place_of(cell: str) -> tuple[bool, bool]:
    """Whether town and conditions are those of the training; a cell is "town-train.dense.test", say."""
    town, _, conditions = cell.split(".")[:3]
    return town.endswith(SEEN), conditions == SEEN


def gap(seen: Sequence[bool], unseen: Sequence[bool]) -> Estimate:
    """Difference of two shares in points, with its interval, which is wide for few drives even where both are 100 %.

    Source: Newcombe 1998, interval estimation for the difference, method 10.
    """
    one, other = share_estimate(seen), share_estimate(unseen)
    assert one.mean is not None
    assert other.mean is not None
    difference, n = one.mean - other.mean, len(seen) + len(unseen)
    if one.low is None or one.high is None or other.low is None or other.high is None:
        return Estimate(difference, None, None, n)
    low = math.hypot(one.mean - one.low, other.high - other.mean)
    high = math.hypot(one.high - one.mean, other.mean - other.low)
    return Estimate(difference, difference - low, difference + high, n)


def gap_beyond(seen: Sequence[tuple[bool, bool]], unseen: Sequence[tuple[bool, bool]]) -> Estimate:
    """How much larger the gap of a driver is than that of another on the same missions, in points.

    Args:
        seen: Success of the driver and of the other one on each mission where the driver learned.
        unseen: The same where it never was.

    Returns:
        The difference, with the interval of resampled missions.
    """
    generator = np.random.default_rng(SEED)
    ahead = [100.0 * np.array([float(one) - float(other) for one, other in some]) for some in (seen, unseen)]
    drawn = [values[generator.integers(len(values), size=(N_RESAMPLES, len(values)))].mean(1) for values in ahead]
    low, high = np.quantile(drawn[0] - drawn[1], (0.025, 0.975))
    return Estimate(float(ahead[0].mean() - ahead[1].mean()), float(low), float(high), len(seen) + len(unseen))
