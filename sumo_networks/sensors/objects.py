"""Objects: everything around, exactly."""

from __future__ import annotations

import math

import numpy as np
from gymnasium.spaces import Box
from numba import njit

from sumo_networks.arrays import Float32Array, FloatArray, IntArray
from sumo_networks.geometry import wrap
from sumo_networks.sensors.base import Sensor, Track
from sumo_networks.world import ActorKind, World

ROWS = 48
COLUMNS = 8


class Objects(Sensor):
    """(48, 8) the nearest actors and other egos within sight, nearest first.

    Columns: kind (`world.ActorKind`), x, y [m, ego frame: centre, x forward, y left], heading relative to the ego
    [rad], speed along that heading [m/s], length, width [m], key (stable while the actor exists). Unused rows have
    kind -1 and zeros.
    """

    name = "objects"
    track = Track.PRIVILEGED
    space = Box(-np.inf, np.inf, (ROWS, COLUMNS), np.float32)

    def read(self, world: World, ego: int) -> Float32Array:
        """See the class."""
        actors, egos = world.actors, world.egos
        kind, key, position = actors.kind, actors.key, actors.position
        heading, speed, length, width = actors.heading, actors.speed, actors.length, actors.width
        if len(egos.names) > 1:
            others = np.flatnonzero(egos.active & (np.arange(len(egos.names)) != ego))
            kind = np.concatenate([kind, np.full(len(others), int(ActorKind.EGO))])
            key = np.concatenate([key, -1 - others])
            position = np.concatenate([position, egos.position[others]])
            heading = np.concatenate([heading, egos.heading[others]])
            speed = np.concatenate([speed, egos.speed[others]])
            length = np.concatenate([length, egos.length[others]])
            width = np.concatenate([width, egos.width[others]])
        x, y = egos.position[ego]
        return _nearest(
            float(x), float(y), float(egos.heading[ego]), kind, key, position, heading, speed, length, width
        )


@njit(cache=True)
def _nearest(
    x: float,
    y: float,
    heading: float,
    kind: IntArray,
    key: IntArray,
    position: FloatArray,
    direction: FloatArray,
    speed: FloatArray,
    length: FloatArray,
    width: FloatArray,
) -> Float32Array:
    out = np.zeros((ROWS, COLUMNS), dtype=np.float32)
    out[:, 0] = -1.0
    cos, sin = math.cos(heading), math.sin(heading)
    distance = np.hypot(position[:, 0] - x, position[:, 1] - y)
    order = np.argsort(distance, kind="mergesort")[:ROWS]
    for row in range(order.shape[0]):
        i = order[row]
        dx, dy = position[i, 0] - x, position[i, 1] - y
        out[row, 0] = kind[i]
        out[row, 1] = dx * cos + dy * sin
        out[row, 2] = dy * cos - dx * sin
        out[row, 3] = wrap(direction[i] - heading)
        out[row, 4] = speed[i]
        out[row, 5] = length[i]
        out[row, 6] = width[i]
        out[row, 7] = key[i]
    return out
