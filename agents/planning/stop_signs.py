"""Stop signs: the next one ahead, and whether the ego has stood at its line."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.rules.right_of_way import RightOfWay

ANOTHER_M: Final = 1.0
"""Growth of the distance to the next stop sign that tells that it is another one."""
PASSED_M, FAR_M = -0.5, 1000.0
STANDS_M_S, STOOD_M = 0.05, 2.5
"""Below this speed, so near to the line, an ego stands there; a bit stricter than the infraction is judged."""


class NextStop:
    """Follows the next stop sign ahead, which may stand behind a junction that comes first.

    Attributes:
        row: Of `sensors.junctions_ahead`; -1 without a sign.
        distance: From the front to its line, m; infinite without a sign.
        stood: Whether the ego has stood there.
    """

    def __init__(self, below: float = STANDS_M_S, within: float = STOOD_M) -> None:
        """Has seen no sign yet: the ego stands below a speed [m/s], within a distance of the line [m]."""
        self._below, self._within = below, within
        self.row, self.distance, self.stood = -1, math.inf, False

    def update(self, speed: float, junctions: Float32Array) -> None:
        """Updates by one tick: speed of the ego [m/s], and `sensors.junctions_ahead`."""
        lines = junctions[:, 0]
        ahead = np.flatnonzero((junctions[:, 3] == RightOfWay.STOP) & (lines >= PASSED_M) & (lines < FAR_M))
        self.row, before = int(ahead[0]) if len(ahead) else -1, self.distance
        self.distance = float(lines[self.row]) if len(ahead) else math.inf
        kept = self.stood and self.distance <= before + ANOTHER_M
        self.stood = kept or (speed < self._below and self.distance < self._within)
