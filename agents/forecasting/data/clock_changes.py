"""Clocks that go back: local times have one hour twice, in the order of the rows or sorted into one."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from dohyo.agents.forecasting.data.grid import usual_step
from dohyo.sumo_networks.arrays import FloatArray

HOUR_S = 3600.0
APART_S = 180 * 86400.0
"""Shortest time between two autumns."""
OFFSETS = "give each time its offset from UTC, such as +02:00 before the change and +01:00 after"


def advice(time_s: FloatArray, local: bool) -> str:
    """What to do about times that do not increase: offsets where clocks went back, else another order of the rows.

    Args:
        time_s: (R,) as in the file.
        local: Whether these are times without a zone.
    """
    steps, step_s = np.diff(time_s), usual_step(time_s)
    back = np.flatnonzero(steps < 0.0)
    after = steps[back] + HOUR_S  # the true time between two rows
    is_hour = step_s is not None and bool(((after > 0.0) & (after < 2.0 * step_s)).all())
    long_before = time_s[back] - time_s[0] > HOUR_S  # in blocks of an hour, one of each detector, it is not
    if local and is_hour and long_before.all() and (np.diff(time_s[back]) > APART_S).all():
        return f": do clocks go back by an hour there? Then {OFFSETS}; else sort the rows"
    return "; sort the rows"


def notes_on_hours(time_s: FloatArray) -> tuple[str, ...]:
    """A note about a single hour of local times whose rows are there twice."""
    twice, step_s = time_s[1:][np.diff(time_s) == 0.0], usual_step(time_s)
    if step_s is None or len(twice) < 2 or (np.diff(twice) != step_s).any() or len(twice) * step_s != HOUR_S:
        return ()
    first, last = (datetime.fromtimestamp(float(time), UTC) for time in (twice[0], twice[-1]))
    return (
        f"rows from {first:%Y-%m-%d %H:%M} to {last:%H:%M} are there twice, and were averaged: if clocks went back "
        f"there, {OFFSETS}",
    )
