"""Standing bottlenecks: ends of congestion, and whether they stay or travel upstream as jams do."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray

CONGESTED = 0.75
"""Share of the free speed below which traffic is congested."""


def heads(speed_mps: FloatArray, free_mps: float, cell_m: float, shift_m: float = 0.0) -> FloatArray:
    """(H,) positions at which congestion ends, going downstream, m.

    Args:
        speed_mps: (X,) smoothed speed along the road.
        free_mps: Free speed.
        cell_m: Length of a cell.
        shift_m: Upstream shift of an end by the smoothing: half the width of a forward kernel.
    """
    slow = speed_mps < CONGESTED * free_mps
    ends = np.flatnonzero(slow[:-1] & ~slow[1:])
    return np.asarray((ends + 1) * cell_m + shift_m)


@dataclass
class BottleneckWatch:
    """Stores the last publications' ends of congestion, and separates the standing one from moving ones.

    An end that was within `near_m` of where it is now in `of` of the last `last` publications stands; the end of a
    moving jam has travelled a kilometre by then.

    Attributes:
        near_m: Largest apparent movement of a standing one.
        last: Number of publications.
        of: Number of them with the same end.
        hold: Number of publications for which it is kept after it is not seen any more.
    """

    near_m: float = 400.0
    last: int = 5
    of: int = 4
    hold: int = 5
    _seen: deque[FloatArray] = field(default_factory=deque, init=False)
    _standing: float | None = field(default=None, init=False)
    _missed: int = field(default=0, init=False)

    def update(self, positions_m: FloatArray) -> float | None:
        """Adds one publication's ends of congestion; position of the standing bottleneck, if there is one, m.

        Of several, the one farthest downstream: those upstream of it are in its queue.
        """
        self._seen.append(np.asarray(positions_m, dtype=np.float64))
        while len(self._seen) > self.last:
            self._seen.popleft()
        found = [float(where) for where in positions_m if self._times(where) >= self.of]
        if found:
            here = max(found)
            nearby = [row[np.abs(row - here) <= self.near_m] for row in self._seen]
            self._standing, self._missed = float(np.median(np.concatenate(nearby))), 0
        elif self._standing is not None:
            self._missed += 1
            if self._missed > self.hold:
                self._standing = None
        return self._standing

    def _times(self, where: float) -> int:
        return sum(bool((np.abs(row - where) <= self.near_m).any()) for row in self._seen)
