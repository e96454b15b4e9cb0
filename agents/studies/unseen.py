"""Unseen: towns and conditions of NoCrash that a training saw or not, and the gap of success between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from dohyo.evaluation.statistics import N_RESAMPLES, SEED, Estimate
from dohyo.sumo_networks.arrays import FloatArray

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
    """Difference of two shares in points, with the interval of independent resamples."""
    generator = np.random.default_rng(SEED)
    shares = [
        100.0 * generator.binomial(len(some), sum(some) / len(some), N_RESAMPLES) / len(some) for some in (seen, unseen)
    ]
    mean = 100.0 * (sum(seen) / len(seen) - sum(unseen) / len(unseen))
    return _estimate(mean, shares[0] - shares[1], len(seen) + len(unseen))


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
    return _estimate(ahead[0].mean() - ahead[1].mean(), drawn[0] - drawn[1], len(seen) + len(unseen))


def _estimate(mean: float, resampled: FloatArray, n: int) -> Estimate:
    low, high = np.quantile(resampled, (0.025, 0.975))
    return Estimate(float(mean), float(low), float(high), n)
