"""Lane: the ego's place in its lane."""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.sensors.base import Sensor, Track
from dohyo.sumo_networks.world import World


class LaneSensor(Sensor):
    """(5,) on a lane (0 or 1), offset from its centre [m, left positive], heading error [rad], width [m], limit [m/s].

    All columns but the first are 0 if no lane is near.
    """

    name = "lane"
    track = Track.MAP
    space = Box(np.array([0, -50, -4, 0, 0], np.float32), np.array([1, 50, 4, 50, 100], np.float32))

    def read(self, world: World, ego: int) -> Float32Array:
        """Reads the array; see the class."""
        egos, lanes = world.egos, world.network.lanes
        lane = int(egos.lane[ego])
        if lane < 0:
            return np.zeros(5, dtype=np.float32)
        row = (1.0, egos.lane_offset[ego], egos.lane_heading_error[ego], lanes.width[lane], lanes.speed[lane])
        return np.array(row, dtype=np.float32)
