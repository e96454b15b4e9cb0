"""What the expert of a kart sees of a lot: boxes that stand, boxes that move, its spot."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.rows import LotView
from dohyo.sumo_networks.parking.rules import Outcome
from dohyo.sumo_networks.parking.tables import OUTCOME, TARGET, WALK_RADIUS, WALK_SPEED, WALK_X, WALK_Y, WALKED
from dohyo.sumo_networks.portable_math import arctan2

WALL_M: Final = 0.02
"""Thickness of a wall in a plan."""


class Scene(NamedTuple):
    """What an expert sees of a lot.

    Attributes:
        fixed: (B, 5) boxes of walls, blocks and parked cars.
        moving: (M, 7) boxes of what may move, each with its velocity, m/s.
        spot: (5,) the target's box.
    """

    fixed: FloatArray
    moving: FloatArray
    spot: FloatArray


def scene_of(lot: LotView, number: int) -> Scene:
    """What the expert of a kart sees."""
    there = lot.counts[:, OUTCOME] != Outcome.ABSENT
    others = np.flatnonzero(there & (np.arange(len(lot.karts)) != number))
    moving = np.concatenate([_karts(lot.karts[others]), _pedestrians(lot.walkers)])
    fixed = np.concatenate([_walls(lot.walls), lot.boxes[:, :5]])
    return Scene(fixed, moving, lot.spots[lot.counts[number, TARGET], :5])


def _walls(walls: FloatArray) -> FloatArray:
    """(W, 5) boxes of walls (W, 4)."""
    dx, dy = walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]
    middle_x, middle_y = (walls[:, 0] + walls[:, 2]) / 2, (walls[:, 1] + walls[:, 3]) / 2
    return np.column_stack([middle_x, middle_y, arctan2(dy, dx), np.hypot(dx, dy), np.full(len(walls), WALL_M)])


def _karts(karts: FloatArray) -> FloatArray:
    """(K, 7) boxes and velocities of karts (K, 10)."""
    size = np.tile([kart.LENGTH_M, kart.WIDTH_M], (len(karts), 1))
    velocity = karts[:, [kart.SPEED]] * karts[:, [kart.COS, kart.SIN]]
    return np.hstack([karts[:, [kart.X, kart.Y, kart.HEADING]], size, velocity])


def _pedestrians(walkers: FloatArray) -> FloatArray:
    """(P, 7) boxes and velocities of pedestrians (P, 9), who walk to and fro between two points."""
    way = walkers[:, 2:4] - walkers[:, :2]
    length = np.maximum(np.hypot(*way.T), 1e-9)
    back = walkers[:, WALKED] % (2.0 * length) > length
    speed = np.where(back, -1.0, 1.0) * walkers[:, WALK_SPEED] / length
    size = 2.0 * np.repeat(walkers[:, [WALK_RADIUS]], 2, axis=1)
    there = np.hstack([walkers[:, [WALK_X, WALK_Y]], np.zeros((len(walkers), 1)), size])
    return np.hstack([there, speed[:, None] * way])
