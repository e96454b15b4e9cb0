"""Speedometer: speed and front wheel angle."""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.sensors.base import Sensor, Track
from dohyo.sumo_networks.world import World


class Speedometer(Sensor):
    """(2,) speed [m/s] and front wheel angle [rad]."""

    name = "speedometer"
    track = Track.SENSORS
    space = Box(np.array([0, -1], np.float32), np.array([100, 1], np.float32))

    def read(self, world: World, ego: int) -> Float32Array:
        """Reads the array; see the class."""
        return np.array([world.egos.speed[ego], world.egos.steering[ego]], dtype=np.float32)
