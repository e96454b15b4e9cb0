"""Path: the route from 12 m behind the ego to the distance that it can drive in 8 s."""

from __future__ import annotations

import math

import numpy as np
from gymnasium.spaces import Box

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.geometry import wrap_angle
from dohyo.sumo_networks.sensors.base import Sensor, Track
from dohyo.sumo_networks.world import World

POINTS = 192
BEHIND = 12


class PathSensor(Sensor):
    """(192, 6) the route's path, a point every metre, from 12 m behind the ego's projection on it to 179 m ahead.

    Columns: x, y [m, ego frame: centre, x forward, y left], heading relative to the ego [rad], curvature [1/m, left
    positive], speed limit [m/s], lane width [m]. Before the start the first point repeats, past the goal the last.
    """

    name = "path"
    track = Track.MAP
    space = Box(-np.inf, np.inf, (POINTS, 6), np.float32)

    def read(self, world: World, ego: int) -> Float32Array:
        """Reads the array; see the class."""
        route, egos = world.routes[ego], world.egos
        rows = route.index(float(egos.progress[ego])) - BEHIND + np.arange(POINTS)
        rows = np.minimum(np.maximum(rows, 0), len(route.position) - 1)
        heading = float(egos.heading[ego])
        dx, dy = (route.position[rows] - egos.position[ego]).T
        cos, sin = math.cos(heading), math.sin(heading)
        out = np.empty((POINTS, 6), dtype=np.float32)
        out[:, 0], out[:, 1] = dx * cos + dy * sin, dy * cos - dx * sin
        out[:, 2], out[:, 3] = wrap_angle(route.heading[rows] - heading), route.curvature[rows]
        out[:, 4], out[:, 5] = route.speed_limit[rows], route.width[rows]
        return out
