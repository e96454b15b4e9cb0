"""Bare numbers as times: minutes, or seconds and their thousandths where the step of the rows is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError

MOST_MINUTES = 1e8
"""Largest number of a column of times that is taken as minutes, 190 years; Unix times are larger since 1973."""
UNITS_S = (1e-9, 1e-6, 1e-3, 1.0, 60.0)
"""Units of columns of numbers, s."""
OTHER_STEP = 4.0
"""Largest factor between the step of the rows and the one that was given by which a unit is still recognised."""


def seconds(path: Path, name: str, numbers: FloatArray, step_s: float | None) -> FloatArray:
    """(R,) numbers of a column of times as seconds.

    Args:
        path: Of the file, for messages.
        name: Of the column.
        numbers: As the file has them.
        step_s: Between two rows; None: the numbers are minutes.

    Raises:
        InvalidInputError: No unit fits.
    """
    if step_s is None:
        return 60.0 * _minutes(path, name, numbers)
    return numbers * _unit_s(path, name, numbers, step_s)


def _unit_s(path: Path, name: str, numbers: FloatArray, step_s: float) -> float:
    """Seconds in one unit of a column of numbers whose rows are about `step_s` apart."""
    steps = np.diff(numbers)
    steps, largest = steps[steps > 0.0], float(np.abs(numbers).max())
    possible = [unit for unit in UNITS_S if largest * unit <= 60.0 * MOST_MINUTES]
    if possible and not len(steps):
        return possible[-1]
    apart = float(np.median(steps)) if len(steps) else 0.0
    if apart == 1.0 and largest <= MOST_MINUTES:
        return step_s  # numbers of rows
    near = [unit for unit in possible if 1.0 / OTHER_STEP <= apart * unit / step_s <= OTHER_STEP]
    if not near:
        raise InvalidInputError(
            f"'{path}': expected minutes, seconds, or thousandths of these in column '{name}', with rows "
            f"{step_s / 60:g} minutes apart (--step), got {numbers[0]:.15g} and rows {apart:.15g} apart"
        )
    return near[0]


def _minutes(path: Path, name: str, numbers: FloatArray) -> FloatArray:
    """Bare numbers as minutes; what looks like a Unix time is refused."""
    if np.abs(numbers).max() > MOST_MINUTES:
        raise InvalidInputError(
            f"'{path}': expected dates or minutes in column '{name}', got {numbers[0]:.15g}; are these seconds or "
            "milliseconds since 1970? Then give the minutes between two rows (--step)"
        )
    return numbers
