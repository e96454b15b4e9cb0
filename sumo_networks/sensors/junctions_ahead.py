"""JunctionsAhead: the next junctions of the route, with signals and right of way."""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.rules.right_of_way import duty
from dohyo.sumo_networks.sensors.base import Sensor, Track
from dohyo.sumo_networks.world import World

ROWS = 4
SIGHT_M = 100.0
_UNUSED = np.array([[1000.0, 1000.0, -1.0, 0.0]] * ROWS, dtype=np.float32)


class JunctionsAhead(Sensor):
    """(4, 4) the next junctions within 100 m of the ego's front, nearest first.

    Columns: distance from the front bumper to the junction (to its stop line, if there is one) [m, negative once
    passed], distance to the junction's end [m], signal (`world.LightState`, -1 if there is none), right of way
    (`rules.right_of_way.RightOfWay`: 0 major, 1 yield, also at a blinking light, 2 stop, at a sign or a green
    right-turn arrow). A junction stays until the ego's front has left it. Unused rows have distances of 1000 and signal
    -1.
    """

    name = "junctions_ahead"
    track = Track.PRIVILEGED
    space = Box(-np.inf, np.inf, (ROWS, 4), np.float32)

    def read(self, world: World, ego: int) -> Float32Array:
        """Reads the array; see the class."""
        front = float(world.egos.progress[ego] + world.egos.length[ego] / 2)
        out = _UNUSED.copy()
        row = 0
        for passage in world.routes[ego].passages:
            if passage.exit < front:
                continue
            if passage.entry - front > SIGHT_M or row == ROWS:
                break
            signal = world.signals[passage.signal] if passage.signal >= 0 else -1
            out[row] = passage.entry - front, passage.exit - front, signal, duty(world, passage)
            row += 1
        return out
