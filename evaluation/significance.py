"""Tests of paired differences: exact over scenarios, and by random effects where several trainings drove them.

Percentile bootstraps are no tests here: a correction over fifty pairs asks for tails of 0.001, where those of a dozen
drives are far too thin.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray

EXACT: Final = 14
"""Number of differences up to which all signs are tried."""
FLIPS: Final = 20_000
SEED: Final = 0
_TOLERANCE: Final = 1e-9  # relative; the last bits of a sum depend on its order


def sign_flips(differences: FloatArray) -> float:
    """Two-sided p-value of the mean of (N,) differences, under which each has either sign with equal chance.

    For successes it is McNemar's exact test. With more than `EXACT` differences that are not 0 it is drawn.

    Source: Fisher 1935; Phipson and Smyth 2010 for drawn signs.
    """
    changed = differences[differences != 0.0]
    if not len(changed):
        return 1.0
    least = abs(math.fsum(changed)) * (1.0 - _TOLERANCE)
    if len(changed) <= EXACT:
        bits = np.arange(2 ** len(changed))[:, None] >> np.arange(len(changed)) & 1
        return float(np.mean(np.abs((1.0 - 2.0 * bits) @ changed) >= least))
    signs = np.random.default_rng(SEED).integers(0, 2, size=(FLIPS, len(changed))) * 2.0 - 1.0
    return float((1 + np.count_nonzero(np.abs(signs @ changed) >= least)) / (FLIPS + 1))


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
