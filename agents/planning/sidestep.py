"""Sidestep: the path that the ego follows while it is off the middle of its lane."""

from __future__ import annotations

import math

import numpy as np

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.portable_math import arctan2

RAMP_M = 12.0


class Sidestep:
    """An offset to the left of the route as a function of progress: a smooth ramp from the last one to the next.

    Attributes:
        offset: Target, m to the left; 0 while it leads back or there is none.
    """

    def __init__(self) -> None:
        self._from = self._to = (0.0, 0.0)
        self.offset = 0.0

    def at(self, progress: float) -> float:
        """Offset at a place of the route, m to the left."""
        (s, d), (end, offset) = self._from, self._to
        share = min(max((progress - s) / max(end - s, 1e-6), 0.0), 1.0)
        return d + (offset - d) * share * share * (3.0 - 2.0 * share)

    def lead(self, offset: float, progress: float, ramp: float = RAMP_M) -> None:
        """Begins a ramp [m] to another offset here."""
        self._from, self._to = (progress, self.at(progress)), (progress + ramp, offset)
        self.offset = offset

    def back(self, progress: float, ramp: float = RAMP_M) -> None:
        """Begins the way back to the middle of the lane here."""
        self.lead(0.0, progress, ramp)

    def aside(self, progress: float) -> bool:
        """Whether the ego is, or is going, off the middle of its lane."""
        return self.offset != 0.0 or abs(self.at(progress)) > 0.05

    def applied(self, route: Float32Array, progress: float, behind: int = 0) -> Float32Array:
        """`route` or `path` observation with its points and headings moved aside.

        Args:
            route: Of which row `behind` is the whole metre nearest to the ego.
            progress: Of the ego, m.
            behind: Number of rows behind the ego.
        """
        if not self.aside(progress):
            return route
        x, y, heading = (float(value) for value in route[behind, :3])
        first = progress + x * math.cos(heading) + y * math.sin(heading) - behind
        offsets = np.array([self.at(first + ahead) for ahead in range(len(route))])
        out = route.copy()
        out[:, 0] -= offsets * np.sin(route[:, 2])
        out[:, 1] += offsets * np.cos(route[:, 2])
        out[:-1, 2] += arctan2(np.diff(offsets), 1.0)
        return out
