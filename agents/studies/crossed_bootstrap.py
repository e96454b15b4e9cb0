"""Crossed bootstrap: means over scenarios and trainings, where each training drove each scenario.

Lost drives are holes, and the mean is over what is there. Where a training drove more scenarios than others, take those
of `common`: a resample that does not draw that training would be a mean over other scenarios.

An interval is over both: a crossed bootstrap, in which the scenarios and the seeds of the training are both drawn with
replacement, each value counting as often as its scenario times its training was drawn (the pigeonhole bootstrap; Owen
2007). With one training, the values count as independent. If all values are equal, resampling gives no interval, and
the values count as independent, one per scenario. With one scenario, such as a return of the training itself, the
interval is Student's over trainings. Three trainings say little about the spread of trainings:
in simulated studies with 40 scenarios, 95 % intervals held the truth in 95 % of cases where trainings differ little,
but in 83 % where they differ as much as scenarios do; in 88 % with five trainings, and in 93 % with ten. With two
trainings and 25 scenarios they held it in 77 %.

A p-value is no bootstrap's, since a correction over fifty claims asks for tails that a bootstrap of a dozen scenarios
has too thin: see `p_value`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, Final

import numpy as np

from dohyo.evaluation.significance import random_effects, sign_flips
from dohyo.evaluation.statistics import N_RESAMPLES, SEED, Estimate, mean_estimate, share_estimate, student_estimate
from dohyo.sumo_networks.arrays import FloatArray, IntArray

Matched = Mapping[tuple[Any, ...], Mapping[int | None, float]]
"""Values by scenario, by seed of the training; None without a training."""
_TAILS: Final = (0.025, 0.975)
ALONE: Final = 0.05
"""What the means of several trainings alone must reach."""
SAME: Final = 1e-4
"""Share of their mean by which trainings may differ and still show no spread; a t-test would take it for certainty."""
DECIMALS: Final = 9
"""Of resampled means: the last bits of a matrix product depend on the processor, and no table may."""


def estimate(matched: Matched, alone: Callable[[Sequence[float]], Estimate] = mean_estimate) -> Estimate:
    """Mean over all drives, with an interval over scenarios and trainings; see the module.

    Args:
        matched: Values.
        alone: Estimate of independent values: of one training, or one per scenario if all are equal.
    """
    table = _table(matched)
    values = table[np.isfinite(table)]
    if table.shape[1] < 2:
        return alone(values.tolist())
    if values.min() == values.max():
        found = alone([float(values[0])] * len(table))
        return Estimate(found.mean, found.low, found.high, len(values))
    if len(table) == 1:
        return student_estimate(values.tolist())
    low, high = np.quantile(_crossed(table, *_counts(*table.shape, N_RESAMPLES)), _TAILS)
    return Estimate(float(values.mean()), float(low), float(high), len(values))


def dense_estimate(matched: Matched) -> Estimate:
    """The same without holes, also with a single training or scenario, which is then not resampled.

    It draws indices instead of counts, so that its random numbers differ from those of `estimate`, which serves where
    there are holes.
    """
    table = _table(matched)
    if not np.isfinite(table).all():
        return estimate(matched)
    low, high = np.quantile(_crossed(table, *_counts_of_indices(*table.shape, N_RESAMPLES)), _TAILS)
    return Estimate(float(table.mean()), float(low), float(high), table.size)


def p_value(matched: Matched) -> float:
    """Two-sided p-value of paired differences: whether their mean is 0.

    It must hold over scenarios, by flipped signs, however often each was driven: four mornings on one side prove
    nothing. With several trainings it must hold over scenarios and trainings, too, by random effects, and their means
    alone must show it at 5 %, by a t-test; three that differ widely prove little. A single scenario is judged by its
    trainings alone; where they show no spread, by flipped signs. In simulated lists of 14 claims without a difference,
    each with three trainings, a false verdict was in 2 % of lists where trainings do not differ, and in 22 % where they
    differ as much as scenarios do.
    """
    table = _table(matched)
    n, k = table.shape
    if n == 1 and np.ptp(table) <= SAME * abs(np.mean(table)):
        return sign_flips(table[0])
    over_scenarios = sign_flips(np.nanmean(table, axis=1)) if n > 1 else 0.0
    if k == 1:
        return over_scenarios
    over_trainings = random_effects(np.nanmean(table, axis=0)[None, :])
    p = max(over_scenarios, random_effects(table))
    return p if over_trainings < ALONE else max(p, over_trainings)


def _table(matched: Matched) -> FloatArray:
    """(N, K) values by scenario and training; NaN where one is missing."""
    trainings = _trainings(matched)
    return np.array([[row.get(seed, math.nan) for seed in trainings] for _, row in sorted(matched.items())])


def _crossed(table: FloatArray, rows: IntArray, columns: IntArray) -> FloatArray:
    """(R,) means of (N, K) values, NaN for missing ones, in which each counts as often as its row times its column.

    Args:
        table: Values.
        rows: (R, N) how often each row was drawn.
        columns: (R, K) how often each column was drawn.
    """
    there = np.isfinite(table)
    sums = ((rows @ np.where(there, table, 0.0)) * columns).sum(axis=1)
    counts = ((rows @ there.astype(float)) * columns).sum(axis=1)
    means: FloatArray = (sums[counts > 0] / counts[counts > 0]).round(DECIMALS)
    return means


@lru_cache(maxsize=4)
def _counts(n: int, k: int, resamples: int) -> tuple[IntArray, IntArray]:
    """How often each of N rows and K columns was drawn, (R, N) and (R, K); the same for all tables of a size."""
    generator = np.random.default_rng(SEED)
    rows, columns = (generator.multinomial(size, np.full(size, 1 / size), resamples) for size in (n, k))
    return rows, columns


@lru_cache(maxsize=4)
def _counts_of_indices(n: int, k: int, resamples: int) -> tuple[IntArray, IntArray]:
    """The same of drawn indices, which are other random numbers."""
    generator = np.random.default_rng(SEED)
    rows, columns = np.empty((resamples, n), np.int64), np.empty((resamples, k), np.int64)
    for row, column in zip(rows, columns, strict=True):
        column[:] = np.bincount(generator.integers(k, size=k), minlength=k)
        row[:] = np.bincount(generator.integers(n, size=n), minlength=n)
    return rows, columns


def of_shares(values: Sequence[float]) -> Estimate:
    """The estimate of independent successes, each above 0."""
    return share_estimate([value > 0.0 for value in values])


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


def common(matched: Matched) -> Matched:
    """Values of the scenarios that all trainings drove."""
    trainings = {*_trainings(matched)}
    return {key: row for key, row in matched.items() if row.keys() == trainings}


def by_training(matched: Matched) -> dict[int | None, float]:
    """Mean of each training."""
    found = {seed: [row[seed] for row in matched.values() if seed in row] for seed in _trainings(matched)}
    return {seed: math.fsum(values) / len(values) for seed, values in found.items()}


def _trainings(matched: Matched) -> list[int | None]:
    return sorted({seed for row in matched.values() for seed in row}, key=lambda seed: -1 if seed is None else seed)
