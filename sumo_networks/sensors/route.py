"""Route: the reference path ahead, and the commands of the navigation."""

from __future__ import annotations

import math

import numpy as np
from gymnasium.spaces import Box
from numba import njit

from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.geometry import wrap
from dohyo.sumo_networks.sensors.base import Sensor, Track
from dohyo.sumo_networks.world import World

POINTS = 80


class RouteSensor(Sensor):
    """(80, 7) path ahead, a point every metre from the ego's projection on the route.

    Columns: x, y [m, ego frame: centre, x forward, y left], heading relative to the ego [rad], curvature [1/m, left
    positive], speed limit [m/s], lane width [m], navigation command (`routing.Command`). Past the goal the last point
    repeats.
    """

    name = "route"
    track = Track.MAP
    space = Box(-np.inf, np.inf, (POINTS, 7), np.float32)

    def read(self, world: World, ego: int) -> Float32Array:
        """Reads the array; see the class."""
        route, egos = world.routes[ego], world.egos
        x, y = egos.position[ego]
        return path_ahead(
            route.index(float(egos.progress[ego])),
            float(x),
            float(y),
            float(egos.heading[ego]),
            route.table,
        )


class Navigation(Sensor):
    """(3,) command (`routing.Command`), distance left on the route [m], distance driven on the route [m]."""

    name = "navigation"
    track = Track.SENSORS
    space = Box(np.zeros(3, np.float32), np.array([5, 1e6, 1e6], np.float32))

    def read(self, world: World, ego: int) -> Float32Array:
        """Reads the array; see the class."""
        route, progress = world.routes[ego], float(world.egos.progress[ego])
        command = route.command[route.index(progress)]
        return np.array([command, max(route.length - progress, 0.0), progress], dtype=np.float32)


@njit(cache=True)
def path_ahead(first: int, x: float, y: float, heading: float, path: FloatArray) -> Float32Array:
    """(80, 7) `Route.table` from a row on, as `RouteSensor` has it, seen from x, y [m], heading [rad]."""
    out = np.empty((POINTS, 7), dtype=np.float32)
    cos, sin = math.cos(heading), math.sin(heading)
    for row in range(POINTS):
        i = min(first + row, path.shape[0] - 1)
        dx, dy = path[i, 0] - x, path[i, 1] - y
        out[row, 0] = dx * cos + dy * sin
        out[row, 1] = dy * cos - dx * sin
        out[row, 2] = wrap(path[i, 2] - heading)
        for column in range(3, 7):
            out[row, column] = path[i, column]
    return out
