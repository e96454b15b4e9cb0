"""Kernels over all lots: what each kart observes."""

from __future__ import annotations

import numpy as np
from numba import njit

from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.parking import kart, radar
from dohyo.sumo_networks.parking.contact import STORED
from dohyo.sumo_networks.parking.limits import MAX_BOXES, MAX_PEDESTRIANS, MAX_SPOTS, MAX_WALLS
from dohyo.sumo_networks.parking.observation import write_radar, write_state
from dohyo.sumo_networks.parking.rules import Outcome
from dohyo.sumo_networks.parking.tables import (
    BOXES,
    HELD,
    KIND,
    LIMIT,
    OUTCOME,
    TARGET,
    TICK,
    WALK_RADIUS,
    WALK_X,
    WALK_Y,
    WALKERS,
    WALLS,
    Tables,
)

_ABSENT, _KART = int(Outcome.ABSENT), int(radar.Kind.KART)


@njit(cache=True)
def observe(tables: Tables, which: BoolArray, out: Float32Array) -> None:
    """Writes observations.

    Args:
        tables: Of N lots.
        which: (N * K,) karts to write.
        out: (N * K, 64) observations.
    """
    walls, boxes, spots, walkers, lots, _, karts, counts = tables
    size = karts.shape[0] // lots.shape[0]
    distance, kind = np.empty(radar.RAYS), np.empty(radar.RAYS, np.int64)
    body = np.empty((1, STORED))
    for row in range(which.shape[0]):
        if not which[row]:
            continue
        lot = row // size
        held_s, elapsed = counts[row, HELD] * kart.SUBSTEP_S, lots[lot, TICK] / lots[lot, LIMIT]
        write_state(karts, row, spots, lot * MAX_SPOTS + counts[row, TARGET], held_s, elapsed, out)
        for ray in range(radar.RAYS):
            distance[ray], kind[ray] = radar.RANGE_M, 0
        eye = karts[row, kart.X], karts[row, kart.Y], karts[row, kart.COS], karts[row, kart.SIN]
        for wall in range(lot * MAX_WALLS, lot * MAX_WALLS + lots[lot, WALLS]):
            radar.meet_wall(eye, walls, wall, distance, kind)
        for box in range(lot * MAX_BOXES, lot * MAX_BOXES + lots[lot, BOXES]):
            if radar.may_meet(eye, boxes[box, 0], boxes[box, 1], boxes[box, 7]):
                radar.meet_box(eye, boxes, box, int(boxes[box, KIND]), distance, kind)
        for other in range(lot * size, (lot + 1) * size):
            if other != row and counts[other, OUTCOME] != _ABSENT:
                _meet_kart(eye, karts, other, body, distance, kind)
        for walker in range(lot * MAX_PEDESTRIANS, lot * MAX_PEDESTRIANS + lots[lot, WALKERS]):
            disc = walkers[walker, WALK_X], walkers[walker, WALK_Y], walkers[walker, WALK_RADIUS]
            if radar.may_meet(eye, *disc):
                radar.meet_disc(eye, disc, distance, kind)
        write_radar(distance, kind, out, row)


@njit(cache=True)
def _meet_kart(
    eye: radar.Eye, karts: FloatArray, other: int, body: FloatArray, distance: FloatArray, kind: IntArray
) -> None:
    body[0, 0], body[0, 1], body[0, 3], body[0, 4] = (
        karts[other, kart.X],
        karts[other, kart.Y],
        kart.LENGTH_M,
        kart.WIDTH_M,
    )
    body[0, 5], body[0, 6], body[0, 7] = karts[other, kart.COS], karts[other, kart.SIN], kart.RADIUS_M
    radar.meet_box(eye, body, 0, _KART, distance, kind)
