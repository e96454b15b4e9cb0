"""Objects: all actors around the ego, without errors."""

from __future__ import annotations

import math

import numpy as np
from gymnasium.spaces import Box
from numba import njit

from dohyo.sumo_networks.arrays import BoolArray, Float32Array, IntArray
from dohyo.sumo_networks.geometry import wrap
from dohyo.sumo_networks.objects import BoxColumns
from dohyo.sumo_networks.sensors.base import Sensor, Track
from dohyo.sumo_networks.units import SIGHT_M
from dohyo.sumo_networks.world import ActorKind, World

ROWS = 48
COLUMNS = 8
_EGO = int(ActorKind.EGO)


class Objects(Sensor):
    """(48, 8) the nearest actors and other egos within sight, 100 m, nearest first.

    Columns: kind (`world.ActorKind`), x, y [m, ego frame: centre, x forward, y left], heading relative to the ego
    [rad], speed along that heading [m/s], length, width [m], key (stable while the actor exists). Unused rows have
    kind -1 and zeros.
    """

    name = "objects"
    track = Track.PRIVILEGED
    space = Box(-np.inf, np.inf, (ROWS, COLUMNS), np.float32)

    def read(self, world: World, ego: int) -> Float32Array:
        """Reads the array; see the class."""
        actors, egos = world.actors, world.egos
        return _nearest(ego, egos.active, egos.columns(), actors.kind, actors.key, actors.columns())


@njit(cache=True)
def _nearest(
    ego: int, active: BoolArray, egos: BoxColumns, kind: IntArray, key: IntArray, actors: BoxColumns
) -> Float32Array:
    """(48, 8) rows of `Objects` for one ego, from the columns of `Egos` and of `Actors`."""
    out = np.zeros((ROWS, COLUMNS), dtype=np.float32)
    out[:, 0] = -1.0
    here, there = egos[0], actors[0]
    x, y, heading = here[ego, 0], here[ego, 1], egos[1][ego]
    count = kind.shape[0]
    distance = np.full(count + active.shape[0], np.inf)
    for i in range(count):
        distance[i] = math.hypot(there[i, 0] - x, there[i, 1] - y)
    for other in range(active.shape[0]):
        if other != ego and active[other]:
            distance[count + other] = math.hypot(here[other, 0] - x, here[other, 1] - y)
    eye = (x, y, heading, math.cos(heading), math.sin(heading))
    # A world of one ego has only what it sees; one of several has what any of them sees.
    sight_m = SIGHT_M if active.shape[0] > 1 else np.inf
    order = np.argsort(distance, kind="mergesort")[:ROWS]
    for row in range(order.shape[0]):
        i, other = order[row], order[row] - count
        if distance[i] == np.inf or distance[i] > sight_m:
            break
        if other < 0:
            out[row, 0], out[row, 7] = kind[i], key[i]
            _write_box(actors, i, eye, out[row])
        else:
            out[row, 0], out[row, 7] = _EGO, -1 - other
            _write_box(egos, other, eye, out[row])
    return out


@njit(cache=True)
def _write_box(boxes: BoxColumns, i: int, eye: tuple[float, float, float, float, float], out: Float32Array) -> None:
    """Writes columns 1 to 6 of one box, relative to an eye: x, y [m], heading [rad], its cosine and its sine."""
    x, y, heading, cos, sin = eye
    position, towards, speed, length, width = boxes
    dx, dy = position[i, 0] - x, position[i, 1] - y
    out[1] = dx * cos + dy * sin
    out[2] = dy * cos - dx * sin
    out[3] = wrap(towards[i] - heading)
    out[4], out[5], out[6] = speed[i], length[i], width[i]
