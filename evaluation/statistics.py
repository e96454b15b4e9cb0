"""Means with 95 % intervals, and paired comparisons.

Intervals are percentile bootstraps, except where resampling shows no spread, or too little: a share of successes has
Wilson's interval, a rate without any event has Poisson's, and a mean of very few values has Student's. 30 successes of
30, or no collision in 10 km, do not prove perfection. Values are sorted before they are resampled and the seed of the
generator is fixed: an estimate depends on the values alone, not on their order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from dohyo.evaluation.significance import FEWEST, differ
from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.errors import InvalidInputError

N_RESAMPLES: Final = 2000
SEED: Final = 0
_TAILS: Final = (0.025, 0.975)
_NORMAL_QUANTILE: Final = 1.959963984540054  # of 0.975
_BLOCK: Final = 2**20

Verdict = Literal["<", "=", ">"]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean with its 95 % interval.

    Attributes:
        mean: Mean; None without values.
        low: Lower end of the 95 % interval; None with fewer than two values.
        high: Upper end of the 95 % interval; None with fewer than two values.
        n: Number of values.
    """

    mean: float | None
    low: float | None
    high: float | None
    n: int


@dataclass(frozen=True, slots=True)
class Comparison:
    """Paired comparison of a and b on matched values.

    Attributes:
        difference: Mean of a - b, with its interval.
        probability: P(a > b), the share of resamples in which that mean is above 0, and half of those in which it is 0;
            None with fewer than `FEWEST` pairs, or where some but fewer than that differ: their resamples are too much
            alike.
        verdict: ">" or "<" where flipped signs tell the mean from 0 at 5 %, a significant difference; else "=". Fewer
            than `FEWEST` pairs show none, whatever their interval.
    """

    difference: Estimate
    probability: float | None
    verdict: Verdict


def mean_estimate(values: Sequence[float], *, n_resamples: int = N_RESAMPLES, seed: int = SEED) -> Estimate:
    """Mean of independent values, with its interval.

    Source: Efron and Tibshirani 1993, percentile bootstrap.

    Raises:
        InvalidInputError: If a value is not finite.
    """
    column = _columns(values)
    n = len(column)
    if n == 0:
        return Estimate(None, None, None, 0)
    return _estimate(math.fsum(values) / n, _resampled_sums(column, n_resamples, seed)[:, 0] / n, n)


def student_estimate(values: Sequence[float]) -> Estimate:
    """Mean of independent values, with Student's interval, which also holds for two or three.

    The bootstrap of three values ends at the smallest and the largest one, and held the mean of normal values in 75 %
    of 600 draws (a trial).

    Source: Student 1908.

    Raises:
        InvalidInputError: If a value is not finite.
    """
    from scipy.special import stdtrit  # type: ignore[import-untyped]  # slow to import: only if needed

    column = _columns(values)[:, 0]
    n = len(column)
    if n < 2:
        return mean_estimate(values)
    mean = math.fsum(values) / n
    half = float(stdtrit(n - 1, _TAILS[1])) * float(np.std(column, ddof=1)) / math.sqrt(n)
    return Estimate(mean, mean - half, mean + half, n)


def share_estimate(successes: Sequence[bool]) -> Estimate:
    """Percentage of successes, with Wilson's score interval.

    Source: Wilson 1927.
    """
    n = len(successes)
    if n == 0:
        return Estimate(None, None, None, 0)
    share = sum(successes) / n
    if n == 1:
        return Estimate(100.0 * share, None, None, 1)
    low, high = _wilson(sum(successes), n)
    return Estimate(100.0 * share, 100.0 * low, 100.0 * high, n)


def percent_estimate(values: Sequence[float]) -> Estimate:
    """`share_estimate` of values that are 0 or 100."""
    return share_estimate([value > 0.0 for value in values])


def _wilson(k: int, n: int) -> tuple[float, float]:
    """Interval of a share of k of n; scipy.stats has it too, but needs a second to import.

    Source: Newcombe 1998, method 3.
    """
    p = k / n
    q, z = 1 - p, _NORMAL_QUANTILE
    denominator = 2 * (n + z**2)
    centre = (2 * n * p + z**2) / denominator
    delta = z / denominator * math.sqrt(4 * n * p * q + z**2)
    return 0.0 if k == 0 else centre - delta, 1.0 if k == n else centre + delta


def ratio_estimate(
    numerators: Sequence[float],
    denominators: Sequence[float],
    *,
    floor: float,
    n_resamples: int = N_RESAMPLES,
    seed: int = SEED,
) -> Estimate:
    """Pooled ratio sum(numerators) / max(floor, sum(denominators)), with its interval.

    Numerator and denominator of one unit are resampled together. Where nothing was counted, the upper end is the exact
    Poisson bound, 3.69 events.

    Args:
        numerators: Numerator of each unit.
        denominators: Denominator of each unit, at least 0.
        floor: Smallest value of the sum of denominators, above 0.
        n_resamples: Number of resamples.
        seed: Seed of the resampling.

    Raises:
        InvalidInputError: If the lengths differ, a value is not finite, or the floor is not above 0.
    """
    if not floor > 0.0:
        raise InvalidInputError(f"expected a floor above 0, got {floor}")
    columns = _columns(numerators, denominators)
    n = len(columns)
    if n == 0:
        return Estimate(None, None, None, 0)
    ratio = math.fsum(numerators) / max(floor, math.fsum(denominators))
    if ratio == 0.0 and n > 1:
        return Estimate(0.0, 0.0, -math.log(_TAILS[0]) / max(floor, math.fsum(denominators)), n)
    sums = _resampled_sums(columns, n_resamples, seed)
    return _estimate(ratio, sums[:, 0] / np.maximum(floor, sums[:, 1]), n)


def grouped_estimate(groups: Sequence[Sequence[float]], alone: Callable[[Sequence[float]], Estimate]) -> Estimate:
    """Mean of all values of groups, such as the egos of one episode, whose values depend on each other.

    Args:
        groups: Values of each group; at least one.
        alone: Estimate of independent values, which it is where every group has one value.

    Returns:
        The mean with the interval of resampled groups; `n` is the number of values. Where all values are equal, which
        resampling shows no spread of, a group counts as one value.
    """
    if all(len(group) == 1 for group in groups):
        return alone([group[0] for group in groups])
    values = [value for group in groups for value in group]
    if len(set(values)) == 1:
        return replace(alone([group[0] for group in groups]), n=len(values))
    found = ratio_estimate([math.fsum(group) for group in groups], [len(group) for group in groups], floor=1.0)
    return replace(found, n=len(values))


def paired(a: Sequence[float], b: Sequence[float], *, n_resamples: int = N_RESAMPLES, seed: int = SEED) -> Comparison:
    """Compares two agents on matched values: a[i] and b[i] come from the same scenario and seed.

    With a single pair there is no interval, and the verdict is "=".

    Raises:
        InvalidInputError: If the lengths differ, there is no pair, or a value is not finite.
    """
    columns = _columns(a, b)
    n = len(columns)
    if n == 0:
        raise InvalidInputError("expected at least one matched pair, got none")
    differences = np.sort(columns[:, 0] - columns[:, 1])
    means = _resampled_sums(differences[:, None], n_resamples, seed)[:, 0] / n
    difference = _estimate(math.fsum(differences) / n, means, n)
    decides = n >= FEWEST and not 0 < np.count_nonzero(differences) < FEWEST
    probability = float(np.mean(means > 0.0) + 0.5 * np.mean(means == 0.0)) if decides else None
    return Comparison(difference, probability, _verdict(differences))


def significantly_below(best: FloatArray, others: FloatArray) -> BoolArray:
    """(k,) whether the verdict of `paired(other, best)` is "<", for many others at once.

    Args:
        best: (n,) values of one agent.
        others: (k, n) values of others on the same scenarios and seeds.

    Raises:
        InvalidInputError: If the lengths differ.
    """
    if others.ndim != 2 or others.shape[1] != len(best):
        raise InvalidInputError(f"expected (k, {len(best)}) values, got {others.shape}")
    differences = np.sort(others - best, axis=1)
    below: BoolArray = (differences.sum(axis=1) < 0.0) & differ(differences)
    return below


def _columns(*columns: Sequence[float]) -> FloatArray:
    """(n, k) the columns side by side, their rows in lexicographic order."""
    lengths = [len(column) for column in columns]
    if len(set(lengths)) != 1:
        raise InvalidInputError(f"expected as many values on both sides, got {lengths}")
    table = np.array(columns, dtype=np.float64).T
    if not np.isfinite(table).all():
        raise InvalidInputError("expected finite values, got NaN or infinity")
    return table[np.lexsort(table.T[::-1])]


def _resampled_sums(columns: FloatArray, n_resamples: int, seed: int) -> FloatArray:
    """(n_resamples, k) column sums of rows drawn with replacement from (n, k), in blocks of bounded memory."""
    if n_resamples < 1:
        raise InvalidInputError(f"expected at least one resample, got {n_resamples}")
    sums = np.empty((n_resamples, columns.shape[1]))
    for start, rows in _resamples(len(columns), n_resamples, seed):
        sums[start : start + len(rows)] = columns[rows].sum(axis=1)
    return sums


def _resamples(n: int, n_resamples: int, seed: int) -> Iterator[tuple[int, IntArray]]:
    """Blocks of resamples: the number of the first one, and (block, n) rows drawn with replacement."""
    generator, block = np.random.default_rng(seed), max(1, _BLOCK // n)
    for start in range(0, n_resamples, block):
        yield start, generator.integers(n, size=(min(block, n_resamples - start), n))


def _estimate(mean: float, resampled: FloatArray, n: int) -> Estimate:
    if n < 2:
        return Estimate(mean, None, None, n)
    low, high = np.quantile(resampled, _TAILS)
    return Estimate(mean, float(low), float(high), n)


def _verdict(differences: FloatArray) -> Verdict:
    if not differ(differences[None])[0]:
        return "="
    return ">" if math.fsum(differences) > 0.0 else "<"
