"""Crossed bootstrap: means over scenarios and trainings, where each training drove each scenario.

An interval is over both: a crossed bootstrap, in which the scenarios and the seeds of the training are both drawn with
replacement, each value counting as often as its scenario times its training was drawn (the pigeonhole bootstrap; Owen
2007). With one training, the values count as independent. If all values are equal, resampling gives no interval, and
the values count as independent, one per scenario. Three trainings say little about the spread of trainings.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from dohyo.evaluation.statistics import N_RESAMPLES, SEED, Estimate, paired
from dohyo.sumo_networks.arrays import FloatArray

Matched = Mapping[tuple[Any, ...], Mapping[int | None, float]]
"""Values by scenario, by seed of the training; None without a training."""
_TAILS: Final = (0.025, 0.975)


def estimate(matched: Matched, alone: Callable[[Sequence[float]], Estimate]) -> Estimate:
    """Mean over all drives, with an interval over scenarios and trainings; see the module.

    Args:
        matched: Values.
        alone: Estimate of independent values: of one training, or one per scenario if all are equal.
    """
    trainings = _trainings(matched)
    table = np.array([[row.get(seed, math.nan) for seed in trainings] for _, row in sorted(matched.items())])
    values = table[np.isfinite(table)]
    if len(trainings) < 2:
        return alone(values.tolist())
    if values.min() == values.max():
        found = alone([float(values[0])] * len(table))
        return Estimate(found.mean, found.low, found.high, len(values))
    low, high = np.quantile(_crossed(table), _TAILS)
    return Estimate(float(values.mean()), float(low), float(high), len(values))


def _crossed(table: FloatArray) -> FloatArray:
    """(R,) means of (N, K) values, NaN for missing ones, with rows and columns drawn with replacement."""
    generator = np.random.default_rng(SEED)
    rows, columns = (generator.multinomial(n, np.full(n, 1 / n), N_RESAMPLES) for n in table.shape)
    there = np.isfinite(table)
    sums = ((rows @ np.where(there, table, 0.0)) * columns).sum(axis=1)
    counts = ((rows @ there.astype(float)) * columns).sum(axis=1)
    means: FloatArray = sums[counts > 0] / counts[counts > 0]
    return means


def of_pairs(values: Sequence[float]) -> Estimate:
    """The estimate of independent differences."""
    return paired(values, [0.0] * len(values)).difference


def difference(mine: Matched, other: Matched) -> Matched:
    """Differences of values that both have, by trainings with the same seed.

    An arm without training, or the shipped one, is compared with every training of the other.
    """
    found: dict[tuple[Any, ...], dict[int | None, float]] = {}
    for key in mine.keys() & other.keys():
        ours, theirs = mine[key], other[key]
        for seed in {*ours, *theirs} - {None} or {None}:
            a, b = ours.get(seed, ours.get(None)), theirs.get(seed, theirs.get(None))
            if a is not None and b is not None:
                found.setdefault(key, {})[seed] = a - b
    return found


def by_training(matched: Matched) -> dict[int | None, float]:
    """Mean of each training."""
    found = {seed: [row[seed] for row in matched.values() if seed in row] for seed in _trainings(matched)}
    return {seed: math.fsum(values) / len(values) for seed, values in found.items()}


def _trainings(matched: Matched) -> list[int | None]:
    return sorted({seed for row in matched.values() for seed in row}, key=lambda seed: -1 if seed is None else seed)


def verdict(found: Estimate) -> str:
    """Side of 0 on which the interval of a difference lies; "no" if it contains 0."""
    if found.low is None or found.high is None or found.low <= 0.0 <= found.high:
        return "no"
    return "above" if found.low > 0.0 else "below"
