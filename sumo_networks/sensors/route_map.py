"""Route map: the route in the network's frame, for agents that must localise themselves."""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.sensors.base import Sensor, Track
from dohyo.sumo_networks.world import World

POINTS = 256
PAGE_M = 50.0


class RouteMap(Sensor):
    """(256, 8) part of the route in the network frame, a point every metre.

    Columns: x, y [m, network frame], heading [rad], curvature [1/m, left positive], speed limit [m/s], lane width [m],
    navigation command (`routing.Command`), distance from the route's start [m]. The part begins at a multiple of 50 m
    that lies 50 to 100 m behind the ego, so that it locates the ego only to 50 m. Past the goal the last point
    repeats, the last column included.
    """

    name = "route_map"
    track = Track.MAP
    space = Box(-np.inf, np.inf, (POINTS, 8), np.float32)

    def read(self, world: World, ego: int) -> Float32Array:
        """Reads the array; see the class."""
        route = world.routes[ego]
        begin = max(PAGE_M * (float(world.egos.progress[ego]) // PAGE_M - 1.0), 0.0)
        last = len(route.position) - 1
        rows = np.minimum(route.index(begin) + np.arange(POINTS), last)
        out = np.empty((POINTS, 8), dtype=np.float32)
        out[:, :2], out[:, 2], out[:, 3] = route.position[rows], route.heading[rows], route.curvature[rows]
        out[:, 4], out[:, 5], out[:, 6] = route.speed_limit[rows], route.width[rows], route.command[rows]
        out[:, 7] = rows * (route.length / last)
        return out
