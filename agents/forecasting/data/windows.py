"""Windows: the last s rows of a road, and the next rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dohyo.agents.forecasting.data.gaps import fill, fillable
from dohyo.agents.forecasting.data.speed_table import DAY_S, Stretch
from dohyo.sumo_networks.arrays import Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.errors import InvalidInputError

HISTORY, HORIZON = 8, 3


@dataclass(frozen=True)
class Windows:
    """B pieces of a table, each within one stretch.

    Attributes:
        history: (B, s, N) measured speeds, gaps filled by `gaps.fill`, m/s.
        target: (B, 3, N) measured speeds of the next rows, NaN where missing, m/s.
        truth: (B, 3, N) the same of all vehicles, if known.
        time_s: (B,) time of day of the last row of each history.
        stretch: (B,) number of the stretch.
        row: (B,) of the history's last row in its stretch.
    """

    history: Float32Array
    target: Float32Array
    truth: Float32Array | None
    time_s: FloatArray
    stretch: IntArray
    row: IntArray

    def __len__(self) -> int:
        return len(self.history)

    def chosen(self, which: IntArray) -> Windows:
        """Selected windows."""
        truth = None if self.truth is None else self.truth[which]
        return Windows(
            self.history[which], self.target[which], truth, self.time_s[which], self.stretch[which], self.row[which]
        )


def make_windows(
    stretches: Sequence[Stretch], step_s: float, history: int = HISTORY, horizon: int = HORIZON
) -> Windows:
    """All windows of some stretches; those whose history, or whose next row, has no value at all are left out.

    Raises:
        InvalidInputError: There is no window.
    """
    parts = [part for i, one in enumerate(stretches) if (part := _of_one(one, i, step_s, history, horizon)) is not None]
    if not parts:
        longest = max((len(one.speeds) for one in stretches), default=0)
        raise InvalidInputError(f"expected {history + horizon} consecutive rows with values, got at most {longest}")
    truths = [part.truth for part in parts if part.truth is not None]
    return Windows(
        np.concatenate([part.history for part in parts]),
        np.concatenate([part.target for part in parts]),
        np.concatenate(truths) if len(truths) == len(parts) else None,
        np.concatenate([part.time_s for part in parts]),
        np.concatenate([part.stretch for part in parts]),
        np.concatenate([part.row for part in parts]),
    )


def _of_one(one: Stretch, number: int, step_s: float, history: int, horizon: int) -> Windows | None:
    n = len(one.speeds) - history - horizon + 1
    if n < 1:
        return None
    pieces = _sliding(one.speeds, history + horizon)
    seen, target = pieces[:, :history], pieces[:, history:]
    usable = np.flatnonzero(fillable(seen) & np.isfinite(target[:, 0]).any(axis=1))
    if not len(usable):
        return None
    row = usable + history - 1
    return Windows(
        history=fill(seen[usable]),
        target=target[usable],
        truth=None if one.truth is None else _sliding(one.truth, history + horizon)[usable, history:],
        time_s=np.asarray((one.start_s + row * step_s) % DAY_S, dtype=np.float64),
        stretch=np.full(len(usable), number),
        row=row,
    )


def _sliding(table: Float32Array, rows: int) -> Float32Array:
    """(T - rows + 1, rows, N) every piece of so many rows."""
    return np.ascontiguousarray(np.moveaxis(np.lib.stride_tricks.sliding_window_view(table, rows, axis=0), -1, 1))
