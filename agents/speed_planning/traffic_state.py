"""Lane-level traffic state: a forecast of the segments, overwritten by the recent speeds of connected vehicles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.freeway.measure import MINUTE_S, Pings
from dohyo.sumo_networks.freeway.road import FreewayRoad

CELL_M = 100.0
"""Length of a sub-segment; ours, a fifth of a segment."""


@dataclass(frozen=True)
class LaneGrid:
    """Lanes x sub-segments of a freeway, from the start of its first segment.

    Attributes:
        bounds_m: (S + 1,) borders of the segments.
        lanes: Number of lanes, L, counted from the left, 1 or more.
        through: (S,) number of the leftmost lanes that lead all through each segment, 1 to L.
        cell_m: Length of a sub-segment.
    """

    bounds_m: FloatArray
    lanes: int
    through: IntArray
    cell_m: float = CELL_M

    @classmethod
    def of(cls, road: FreewayRoad) -> LaneGrid:
        """Grid of a road, with the largest number of lanes, including ramps'."""
        return cls(road.bounds_m, 1 + max(track.lane for track in road.tracks.values()), np.array(road.lanes))

    @property
    def cells(self) -> int:
        """Sub-segments of one lane, X; the last may reach beyond the last segment."""
        return int(np.ceil(self.bounds_m[-1] / self.cell_m))

    @property
    def centres_m(self) -> FloatArray:
        """(X,) middle of each sub-segment."""
        return np.asarray((np.arange(self.cells) + 0.5) * self.cell_m)

    def spread(self, segment_mps: FloatArray) -> FloatArray:
        """(S,) speeds of segments -> (L, X), the same for every lane and all of a segment.

        Raises:
            InvalidInputError: The number of segments differs.
        """
        if segment_mps.shape != (len(self.bounds_m) - 1,):
            raise InvalidInputError(f"expected speeds of {len(self.bounds_m) - 1} segments, got {segment_mps.shape}")
        return np.repeat(segment_mps[self._segment][None], self.lanes, axis=0)

    def across(self, state: FloatArray) -> FloatArray:
        """(L, X) speeds -> (X,) mean over the lanes that lead all through each segment, without ramps' lanes."""
        there = np.arange(self.lanes)[:, None] < self.through[self._segment]
        return np.asarray(np.mean(state, axis=0, where=there))

    @property
    def _segment(self) -> IntArray:
        """(X,) segment of each sub-segment."""
        return np.clip(np.searchsorted(self.bounds_m, self.centres_m, side="right") - 1, 0, len(self.through) - 1)


def fuse(grid: LaneGrid, state: FloatArray, pings: Pings, time_s: float, window_s: float = MINUTE_S) -> FloatArray:
    """Overwrites sub-segments by the mean speed of the connected vehicles that were in them.

    A vehicle counts once in a sub-segment, with the mean of its pings there; otherwise slow ones would count more.

    Args:
        grid: The sub-segments.
        state: (L, X) m/s, left as it is.
        pings: Of the vehicles.
        time_s: Present time.
        window_s: Pings older than this are left out.

    Returns:
        (L, X) m/s.
    """
    inside = (pings.position_m >= 0) & (pings.position_m < grid.cells * grid.cell_m)
    kept = inside & (pings.time_s > time_s - window_s) & (pings.lane >= 0) & (pings.lane < grid.lanes)
    if not kept.any():
        return state.copy()
    cell = pings.lane[kept] * grid.cells + (pings.position_m[kept] / grid.cell_m).astype(np.int64)
    _, who = np.unique(pings.name[kept], return_inverse=True)
    size = grid.lanes * grid.cells
    visits, visit = np.unique(who * size + cell, return_inverse=True)
    own = np.bincount(visit, weights=pings.speed_mps[kept]) / np.bincount(visit)
    total = np.bincount(visits % size, weights=own, minlength=size)
    count = np.bincount(visits % size, minlength=size)
    mean = (total / np.maximum(count, 1)).reshape(state.shape)
    return np.where(count.reshape(state.shape) > 0, mean, state)


def forward_kernel(state: FloatArray, width_m: float, cell_m: float) -> FloatArray:
    """Mean speed of the road ahead: U(x) = integral of K(s) v(x + s) over [0, w] / integral of K, K uniform.

    Near the road's end only the rest of it counts.

    Args:
        state: (..., X) m/s.
        width_m: w.
        cell_m: Length of a cell.

    Returns:
        (..., X) m/s.
    """
    cells = state.shape[-1]
    width = max(1, round(width_m / cell_m))
    sums = np.concatenate([np.zeros((*state.shape[:-1], 1)), np.cumsum(state, axis=-1)], axis=-1)
    ends = np.minimum(np.arange(cells) + width, cells)
    return np.asarray((sums[..., ends] - sums[..., :cells]) / (ends - np.arange(cells)))
