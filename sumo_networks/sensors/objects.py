"""Objects: everything around, exactly."""

from __future__ import annotations

import math

import numpy as np
from gymnasium.spaces import Box
from numba import njit

from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.geometry import wrap
from dohyo.sumo_networks.sensors.base import Sensor, Track
from dohyo.sumo_networks.world import ActorKind, World

ROWS = 48
COLUMNS = 8
_EGO = int(ActorKind.EGO)


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
        return _nearest(
            ego,
            actors.kind,
            actors.key,
            actors.position,
            actors.heading,
            actors.speed,
            actors.length,
            actors.width,
            egos.active,
            egos.position,
            egos.heading,
            egos.speed,
            egos.length,
            egos.width,
        )


@njit(cache=True)
def _nearest(
    ego: int,
    kind: IntArray,
    key: IntArray,
    position: FloatArray,
    direction: FloatArray,
    speed: FloatArray,
    length: FloatArray,
    width: FloatArray,
    ego_active: BoolArray,
    ego_position: FloatArray,
    ego_direction: FloatArray,
    ego_speed: FloatArray,
    ego_length: FloatArray,
    ego_width: FloatArray,
) -> Float32Array:
    """(48, 8) what `Objects` says, of the columns of `Actors` and of `Egos`."""
    out = np.zeros((ROWS, COLUMNS), dtype=np.float32)
    out[:, 0] = -1.0
    x, y, heading = ego_position[ego, 0], ego_position[ego, 1], ego_direction[ego]
    actors = kind.shape[0]
    distance = np.full(actors + ego_active.shape[0], np.inf)
    for i in range(actors):
        distance[i] = math.hypot(position[i, 0] - x, position[i, 1] - y)
    for other in range(ego_active.shape[0]):
        if other != ego and ego_active[other]:
            distance[actors + other] = math.hypot(ego_position[other, 0] - x, ego_position[other, 1] - y)
    cos, sin = math.cos(heading), math.sin(heading)
    order = np.argsort(distance, kind="mergesort")[:ROWS]
    for row in range(order.shape[0]):
        i, other = order[row], order[row] - actors
        if distance[i] == np.inf:
            break
        if other < 0:
            out[row, 0], out[row, 7] = kind[i], key[i]
            px, py, towards = position[i, 0], position[i, 1], direction[i]
            out[row, 4], out[row, 5], out[row, 6] = speed[i], length[i], width[i]
        else:
            out[row, 0], out[row, 7] = _EGO, -1 - other
            px, py, towards = ego_position[other, 0], ego_position[other, 1], ego_direction[other]
            out[row, 4], out[row, 5], out[row, 6] = ego_speed[other], ego_length[other], ego_width[other]
        dx, dy = px - x, py - y
        out[row, 1] = dx * cos + dy * sin
        out[row, 2] = dy * cos - dx * sin
        out[row, 3] = wrap(towards - heading)
    return out
