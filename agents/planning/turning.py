"""Turning: by how much the ego has turned since the last tick, seen from the route."""

from __future__ import annotations

import math

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.geometry import wrap
from dohyo.sumo_networks.units import TICK_S


class Turning:
    """Compares the direction of one point of the route in two ticks: what it has turned by, the ego has turned back."""

    def __init__(self) -> None:
        self._before: Float32Array | None = None

    def update(self, route: Float32Array, speed: float) -> float:
        """Change of the ego's heading since the last tick, rad, to the left; 0 in the first one.

        Args:
            route: (80, 7), see `sensors.route`, which begins at the whole metre nearest to the ego.
            speed: Of the ego, m/s.
        """
        before, self._before = self._before, route
        if before is None:
            return 0.0
        passed = round(_beyond_first(before) + speed * TICK_S - _beyond_first(route))
        row = min(max(passed, 0), len(before) - 1)
        return wrap(float(before[row, 2]) - float(route[0, 2]))


def _beyond_first(route: Float32Array) -> float:
    """Metres along the route from its first point to the ego."""
    x, y, heading = (float(value) for value in route[0, :3])
    return -x * math.cos(heading) - y * math.sin(heading)
