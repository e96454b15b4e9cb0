"""Ego state: the ego's own motion, exactly."""

from __future__ import annotations

import math

import numpy as np
from gymnasium.spaces import Box

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.geometry import wrap
from dohyo.sumo_networks.sensors.base import Sensor, Track
from dohyo.sumo_networks.world import World


class EgoState(Sensor):
    """(9,) x, y [m], heading [rad], speed, acceleration, yaw rate, steering [rad], length, width [m] of the ego.

    x, y and heading of the box centre are in the frame of the route's first point (x along the route there, y to its
    left). They show motion from tick to tick, but not the place on the map. Speed is in m/s, acceleration in
    m/s^2, yaw rate in rad/s; steering is the front wheel angle.
    """

    name = "ego_state"
    track = Track.PRIVILEGED
    space = Box(-np.inf, np.inf, (9,), np.float32)

    def read(self, world: World, ego: int) -> Float32Array:
        """Reads the array; see the class."""
        egos, route = world.egos, world.routes[ego]
        (dx, dy), first = egos.position[ego] - route.position[0], float(route.heading[0])
        cos, sin = math.cos(first), math.sin(first)
        pose = (dx * cos + dy * sin, dy * cos - dx * sin, wrap(float(egos.heading[ego]) - first))
        motion = (egos.speed[ego], egos.acceleration[ego], egos.yaw_rate[ego], egos.steering[ego])
        return np.array([*pose, *motion, egos.length[ego], egos.width[ego]], dtype=np.float32)
