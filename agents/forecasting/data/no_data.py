"""Numbers that probably stand for missing speeds, such as 255 or single zeros on a free road, told in notes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dohyo.agents.forecasting.data.speed_table import UNITS
from dohyo.sumo_networks.arrays import Float32Array

MOST_MPS = 250.0 / 3.6
"""Speed above which no mean of a road's vehicles lies."""
JUMP_MPS = 30.0 / 3.6
LONGEST_RUN = 3
"""Rows of one number in a row that a jam rarely has alone."""
FEWEST_RUNS = 3
MORE_OFTEN = 2
"""Factor by which such a number is more frequent than each number near it."""


def no_data_notes(columns: Sequence[Float32Array], names: Sequence[str], unit: str) -> tuple[str, ...]:
    """Notes about numbers that probably mean a missing speed.

    Args:
        columns: (R,) each, as reported, m/s, NaN where missing; columns of other files may be longer.
        names: Of the columns.
        unit: In which they were read.
    """
    known = [column[np.isfinite(column)] for column in columns]
    found: dict[float, list[int]] = {}
    for number, column in enumerate(known):
        possible = column[column <= MOST_MPS]
        for value in _repeated_ends(possible):
            if _stands_alone(possible, value):
                found.setdefault(value, []).append(number)
    around = f", most of them between values at least {3.6 * JUMP_MPS:.0f} km/h away"
    alone = [_note(known, names, unit, value, where, around) for value, where in found.items()]
    return (*_above(known, names, unit), *alone)


def _above(known: Sequence[Float32Array], names: Sequence[str], unit: str) -> tuple[str, ...]:
    """A note about speeds that no road has."""
    where = [number for number, column in enumerate(known) if (column > MOST_MPS).any()]
    if not where:
        return ()
    values, counts = np.unique(np.concatenate([known[i][known[i] > MOST_MPS] for i in where]), return_counts=True)
    value, count = float(values[counts.argmax()]), int(counts.max())
    if count > 1 and 2 * count >= counts.sum():
        same = [number for number in where if (known[number] == np.float32(value)).any()]
        return (_note(known, names, unit, value, same, ""),)
    return (
        f"{counts.sum()} values are above {MOST_MPS / UNITS[unit]:.0f} {unit}, up to "
        f"{float(values[-1]) / UNITS[unit]:.6g} {unit} ({_where(where, names)}); if these mean missing: leave their "
        "cells empty, or --missing-value where it is one number",
    )


def _repeated_ends(known: Float32Array) -> list[float]:
    """Smallest and largest value, where it is there often enough."""
    ends = [known.min(), known.max()] if len(known) else []
    return [float(end) for end in ends if (known == end).sum() >= FEWEST_RUNS]


def _stands_alone(known: Float32Array, value: float) -> bool:
    """Whether a number mostly comes in short runs with jumps on both sides, and more often than each number near it."""
    same = known == np.float32(value)
    edges = np.flatnonzero(np.diff(same.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    begin, end = edges[(edges[:, 0] > 0) & (edges[:, 1] < len(known))].T
    far = np.abs(known - np.float32(value)) >= JUMP_MPS
    alone = (end - begin <= LONGEST_RUN) & far[begin - 1] & far[end]
    if alone.sum() < FEWEST_RUNS or 2 * (end - begin)[alone].sum() < same.sum():
        return False
    near = np.unique(known[~far & ~same], return_counts=True)[1]
    return bool(same.sum() > MORE_OFTEN * near.max(initial=0))


def _note(
    known: Sequence[Float32Array], names: Sequence[str], unit: str, value: float, where: Sequence[int], around: str
) -> str:
    count = sum(int((known[number] == np.float32(value)).sum()) for number in where)
    raw = f"{value / UNITS[unit]:.6g}"
    return (
        f"{count} values are exactly {raw} {unit}{around} ({_where(where, names)}); if that means missing: "
        f"--missing-value {raw}"
    )


def _where(columns: Sequence[int], names: Sequence[str]) -> str:
    """Which columns."""
    first = f"'{names[columns[0]]}'"
    return f"column {first}" if len(columns) == 1 else f"{len(columns)} of {len(names)} columns, such as {first}"
