"""Exits: junctions ahead whose exit has no room for the ego, so that it would come to stand inside."""

from __future__ import annotations

import math
from collections.abc import Iterable
from operator import attrgetter
from typing import Final

import numpy as np

from dohyo.agents.planning.surroundings import Neighbour
from dohyo.sumo_networks.arrays import BoolArray, Float32Array
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import LightState

SLOW_M_S: Final = 3.0
"""Below this speed an actor ahead may stop where it is; a faster one leaves the junction."""
SPACE_M: Final = 2.0
"""Between cars that stand."""
BRAKING_M_S2: Final = 3.5
"""With which the ego still stops before such a junction; harder than that it drives on, as at yellow."""
SIDE_M: Final = 0.3
"""Beside the ego's box, within which an actor is in its way."""
STANDS_M_S, PATIENCE_S = 0.3, 60.0


class ExitMonitor:
    """Closes the junctions before which the ego can still stop, and behind which a queue leaves it no room.

    An ego that has waited for `PATIENCE_S` goes: what stands there may be no queue, and may have to be passed.

    Attributes:
        waits: Whether a junction is closed for want of room.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Clears the state of the last episode."""
        self.waits, self._waited_s = False, 0.0

    def update(self, speed: float, junctions: Float32Array, neighbours: Iterable[Neighbour]) -> Float32Array:
        """Updates by one tick.

        Args:
            speed: Of the ego, m/s.
            junctions: (4, 4), see `sensors.junctions_ahead`.
            neighbours: Actors in the frame of the route.

        Returns:
            (4, 4) the junctions, where one without room has a red light, so that whoever obeys lights waits before it.
        """
        full = without_room(speed, junctions, neighbours)
        if not full.any():
            self.reset()
            return junctions
        self._waited_s += TICK_S * (speed < STANDS_M_S)
        self.waits = self._waited_s < PATIENCE_S
        if not self.waits:
            return junctions
        closed = junctions.copy()
        closed[full, 2] = LightState.RED
        return closed


def without_room(speed: float, junctions: Float32Array, neighbours: Iterable[Neighbour]) -> BoolArray:
    """(4,) junctions that `ExitMonitor` closes, without its patience; arguments are those of `ExitMonitor.update`.

    A queue is an actor in the ego's way, inside the junction or behind it, that stands or creeps. Whoever drives
    between it and the ego takes a place before the ego does.
    """
    ego = VehicleParameters()
    front, side = ego.length / 2, ego.width / 2 + SIDE_M
    ahead = sorted(
        (one for one in neighbours if one.s_low > front and one.within(-side, side)), key=attrgetter("s_low")
    )
    full = np.zeros(len(junctions), dtype=np.bool_)
    for row, (entry, end) in enumerate(junctions[:, :2].tolist()):
        if entry > 0.0 and speed**2 / (2.0 * entry) < BRAKING_M_S2:
            full[row] = _room(ahead, front + entry, front + end) < ego.length + SPACE_M
    return full


def _room(ahead: Iterable[Neighbour], entry: float, end: float) -> float:
    """Room between a junction's end and the queue behind it, m; infinite without a queue.

    Args:
        ahead: Actors in the ego's way, nearest first.
        entry: Of the junction, m along the route.
        end: Of the junction.
    """
    taken = 0.0
    for one in ahead:
        if one.s_high > entry and one.speed < SLOW_M_S:
            return one.s_low - end - taken
        taken += one.s_high - one.s_low + SPACE_M
    return math.inf
