"""Tests of paired differences: exact over scenarios, and by random effects where several trainings drove them.

Percentile bootstraps are no tests here: a correction over fifty pairs asks for tails of 0.001, where those of a dozen
drives are far too thin.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from dohyo.sumo_networks.arrays import BoolArray, FloatArray

EXACT: Final = 30
"""Number of differences up to which all signs count; near a corrected threshold, drawn ones decide by luck."""
FLIPS: Final = 20_000
_AGAIN: Final = 10
"""How many times as many signs are drawn where the first share is small, and a correction will multiply it."""
_SMALL: Final = 0.02
_LISTED: Final = 14  # differences whose signs are cheap to list
_NEAR: Final = 0.01  # more than six standard errors of a drawn share at `LEVEL`
SEED: Final = 0
LEVEL: Final = 0.05
FEWEST: Final = 6
"""Fewest differences that can be told from 0: 2 of 2^6 flips are as far, a share of 0.03; of 2^5 they are 0.06."""
_CERTAIN: Final = 2.8
"""Sums that are as many standard deviations from 0 are beyond `LEVEL`: 2 exp(-2.8^2 / 2) is 0.04 (Hoeffding 1963).

Those within one are not: at least 7 of 32 flips are as far (Dvořák and Tiep 2020).
"""
_BLOCK: Final = 64  # rows whose flips are in memory at once
_TOLERANCE: Final = 1e-9  # relative; the last bits of a sum depend on its order


def sign_flips(differences: FloatArray) -> float:
    """Two-sided p-value of the mean of (N,) differences, under which each has either sign with equal chance.

    For successes it is McNemar's exact test. With more than `EXACT` differences that are not 0 it is drawn. The order
    of the differences is without effect.

    Source: Fisher 1935; Phipson and Smyth 2010 for drawn signs.
    """
    changed = np.sort(differences[differences != 0.0])
    if not len(changed):
        return 1.0
    if len(changed) <= EXACT:
        return _exact(changed)
    first = float(_drawn(changed[None])[0])
    return float(_drawn(changed[None], _AGAIN)[0]) if first < _SMALL else first


def differ(table: FloatArray) -> BoolArray:
    """(K,) whether the p-value of `sign_flips` is below `LEVEL`, for each row of (K, N) differences."""
    found = np.zeros(len(table), dtype=np.bool_)
    counts, squares = np.count_nonzero(table, axis=1), np.square(table).sum(axis=1)
    # |sum| in its standard deviations under flipped signs; far sums need no flips.
    apart = np.abs(table.sum(axis=1)) / np.sqrt(np.where(squares > 0.0, squares, 1.0))
    found[(counts > _LISTED) & (apart > _CERTAIN)] = True
    open_ = (counts > 0) & ~found & (apart >= 1.0)
    for count in np.unique(counts[open_]).tolist():
        rows = np.flatnonzero(open_ & (counts == count))
        changed = table[rows]
        found[rows] = _below_level(np.sort(changed[changed != 0.0].reshape(len(rows), count), axis=1))
    return found


def _below_level(rows: FloatArray) -> BoolArray:
    """(R,) whether p-values of (R, N) sorted differences are below `LEVEL`; drawn ones decide only far from it."""
    count = rows.shape[1]
    if count <= _LISTED:
        return np.array([_exact(row) for row in rows]) < LEVEL
    values = _drawn(rows)
    if count <= EXACT:
        for near in np.flatnonzero(np.abs(values - LEVEL) < _NEAR):
            values[near] = _exact(rows[near])
    return values < LEVEL


def _exact(row: FloatArray) -> float:
    """P-value of (N,) differences, none of which is 0: the share of all 2^N sums that are as far.

    Sums of one half of the differences meet those of the other.

    Source: Horowitz and Sahni 1974, for the halves.
    """
    least = abs(math.fsum(row)) * (1.0 - _TOLERANCE)
    if least == 0.0:
        return 1.0
    middle = len(row) // 2
    ours, theirs = _sums(row[:middle]), _sums(row[middle:])
    above = len(theirs) - np.searchsorted(theirs, least - ours, side="left")
    below = np.searchsorted(theirs, -least - ours, side="right")
    return float(above.sum() + below.sum()) / 2.0 ** len(row)


def _sums(row: FloatArray) -> FloatArray:
    """(2^N,) sums of differences under all signs, in ascending order."""
    sums = np.zeros(1)
    for one in row:
        sums = np.concatenate([sums - one, sums + one])
    return np.sort(sums)


def _drawn(rows: FloatArray, times: int = 1) -> FloatArray:
    """(R,) p-values of (R, N) differences, none of which is 0, by `times` * `FLIPS` drawn signs."""
    rng, hits = np.random.default_rng(SEED), np.zeros(len(rows))
    least = np.array([abs(math.fsum(row)) for row in rows]) * (1.0 - _TOLERANCE)
    for _ in range(times):
        signs = rng.integers(0, 2, size=(FLIPS, rows.shape[1])) * 2.0 - 1.0
        for start in range(0, len(rows), _BLOCK):
            block = slice(start, start + _BLOCK)
            hits[block] += np.count_nonzero(np.abs(rows[block] @ signs.T) >= least[block, None], axis=1)
    return (1.0 + hits) / (times * FLIPS + 1)


def random_effects(table: FloatArray) -> float:
    """Two-sided p-value of the mean of (N, K) differences, by scenario and training, both of which are drawn.

    The variance of the mean is estimated from scenarios, trainings and what is left; few trainings that differ have few
    degrees of freedom. Missing values (NaN) are filled in from their row and column. One training or one scenario alone
    is a t-test.

    Source: Satterthwaite 1946; Clark 1973 for the quasi-F of scenarios and subjects.
    """
    values = _filled(table)
    n, k = values.shape
    mean = float(values.mean())
    rows, columns = values.mean(axis=1), values.mean(axis=0)
    rest = values - rows[:, None] - columns + mean
    of_rows = k * float(np.sum((rows - mean) ** 2)) / max(n - 1, 1)
    of_columns = n * float(np.sum((columns - mean) ** 2)) / max(k - 1, 1)
    of_rest = float(np.sum(rest**2)) / max((n - 1) * (k - 1), 1)
    # Each of the two alone explains at least its own spread.
    square = max(of_rows + of_columns - of_rest, of_rows, of_columns)
    if square <= _TOLERANCE * mean**2:
        return 1.0 if mean == 0.0 else 0.0
    parts = [(part, free) for part, free in ((of_rows, n - 1), (of_columns, k - 1)) if free]
    if n > 1 and k > 1:
        parts.append((of_rest, (n - 1) * (k - 1)))
    freedom = min(square**2 / sum(part**2 / free for part, free in parts), n * k - 1)
    return _student(abs(mean) / math.sqrt(square / (n * k)), max(freedom, 1.0))


def _filled(table: FloatArray) -> FloatArray:
    """The table with its holes filled by the additive model of rows and columns."""
    missing = ~np.isfinite(table)
    if not missing.any():
        return table
    filled = np.where(missing, np.nanmean(table), table)
    for _ in range(100):
        guess = filled.mean(axis=1)[:, None] + filled.mean(axis=0) - filled.mean()
        filled = np.where(missing, guess, table)
    return filled


def _student(t: float, freedom: float) -> float:
    """Two-sided p-value of Student's t."""
    from scipy.special import stdtr  # type: ignore[import-untyped]  # slow to import: only if needed

    return float(2.0 * stdtr(freedom, -t))
