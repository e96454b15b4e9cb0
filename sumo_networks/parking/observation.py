"""Observation of a kart: the thesis's state, our additions to it, and the radar, one float32 per column.

| columns | meaning | scale |
|---|---|---|
| 0 | heading in the lot's frame | pi |
| 1-3 | position of the kart in the lot's frame (z is 0) | 80 m |
| 4-5 | velocity in the lot's frame | 5.6 m/s, the highest speed |
| 6-8 | position of the target spot in the lot's frame (z is 0) | 80 m |
| 9-11 | spot minus kart (z is 0) | 80 m |
| 12-13 | ours: cosine and sine of heading minus the spot's heading | 1 |
| 14-15 | ours: the kart in the spot's frame, ahead of and left of its centre, cut at +-1 | 5 m |
| 16 | ours: steering angle | 30 degrees |
| 17 | ours: time in place, cut at 1 | 1 s |
| 18 | ours: time since the episode began | time limit |
| 19-63 | radar, ray by ray from -60 to +60 degrees: distance; 1 if wall; car; kart; pedestrian | 80 m |

Columns 0-8 are the thesis's first state space and columns 0-11 its second one.
"""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np
from gymnasium.spaces import Box
from numba import njit

from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.errors import UnknownNameError
from dohyo.sumo_networks.parking import kart, radar
from dohyo.sumo_networks.parking.contact import STORED
from dohyo.sumo_networks.parking.limits import MAX_BOXES, MAX_PEDESTRIANS, MAX_SPOTS, MAX_WALLS
from dohyo.sumo_networks.parking.radar import RANGE_M, RAYS, Kind
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

State = Literal["v1", "v2", "oriented"]
"""Columns beside the radar: those of the thesis's first or second state space, or also ours."""
POSITION_SCALE_M: Final = 80.0
NEAR_M: Final = 5.0
RADAR: Final = 19
"""First column of the radar."""
PER_RAY: Final = len(Kind)
COLUMNS: Final = RADAR + PER_RAY * RAYS

HIGHEST: Final = np.float32(2.0)
"""No column leaves +-2: a lot's coordinates end at 160 m; karts and differences that are farther are cut there."""
_ABSENT, _KART = int(Outcome.ABSENT), int(Kind.KART)


def columns(state: State) -> IntArray:
    """Indices of the columns of an observation with a state, in their order.

    Raises:
        UnknownNameError: There is no such state.
    """
    ends = {"v1": 9, "v2": 12, "oriented": RADAR}
    if state not in ends:
        raise UnknownNameError("state", state, ends)
    last = ends[state]
    return np.concatenate([np.arange(last), np.arange(RADAR, COLUMNS)])


def observation_space(state: State = "oriented") -> Box:
    """Space of one kart's observation."""
    return Box(-HIGHEST, HIGHEST, (len(columns(state)),), np.float32)


def action_space() -> Box:
    """Motor torque (negative: backwards), steering angle (positive: left), brake torque (none below 0), as shares."""
    return Box(-1.0, 1.0, (3,), np.float32)


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
        _write_state(karts, row, spots, lot * MAX_SPOTS + counts[row, TARGET], held_s, elapsed, out)
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
        _write_radar(distance, kind, out, row)


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


@njit(cache=True)
def _write_state(
    karts: FloatArray, number: int, spots: FloatArray, spot: int, held_s: float, elapsed: float, out: Float32Array
) -> None:
    """Writes columns 0 to 18.

    Args:
        karts: (K, 10) states.
        number: Row of the kart.
        spots: (S, 8) stored boxes.
        spot: Row of its target.
        held_s: Time in place, s.
        elapsed: Share of the time limit.
        out: (K, 64) observations.
    """
    cos, sin, spot_cos, spot_sin = karts[number, kart.COS], karts[number, kart.SIN], spots[spot, 5], spots[spot, 6]
    x, y, spot_x, spot_y = karts[number, kart.X], karts[number, kart.Y], spots[spot, 0], spots[spot, 1]
    dx, dy = spot_x - x, spot_y - y
    out[number, 0] = karts[number, kart.HEADING] / math.pi
    out[number, 1], out[number, 2], out[number, 3] = _cut(x / POSITION_SCALE_M), _cut(y / POSITION_SCALE_M), 0.0
    speed = karts[number, kart.SPEED] / kart.MAX_SPEED_MPS
    out[number, 4], out[number, 5] = speed * cos, speed * sin
    out[number, 6], out[number, 7], out[number, 8] = (
        _cut(spot_x / POSITION_SCALE_M),
        _cut(spot_y / POSITION_SCALE_M),
        0.0,
    )
    out[number, 9], out[number, 10], out[number, 11] = _cut(dx / POSITION_SCALE_M), _cut(dy / POSITION_SCALE_M), 0.0
    out[number, 12], out[number, 13] = cos * spot_cos + sin * spot_sin, sin * spot_cos - cos * spot_sin
    ahead, left = -(dx * spot_cos + dy * spot_sin), -(dy * spot_cos - dx * spot_sin)
    out[number, 14], out[number, 15] = min(max(ahead / NEAR_M, -1.0), 1.0), min(max(left / NEAR_M, -1.0), 1.0)
    out[number, 16] = karts[number, kart.STEERING] / kart.MAX_STEERING_RAD
    out[number, 17], out[number, 18] = min(held_s, 1.0), elapsed


@njit(cache=True)
def _write_radar(distance: FloatArray, kind: IntArray, out: Float32Array, number: int) -> None:
    """Writes columns 19 to 63 of a row from (9,) distances [m] and kinds."""
    for column in range(RADAR, COLUMNS):
        out[number, column] = 0.0
    for ray in range(RAYS):
        first = RADAR + PER_RAY * ray
        out[number, first] = distance[ray] / RANGE_M
        if kind[ray] > 0:
            out[number, first + kind[ray]] = 1.0


@njit(cache=True)
def _cut(value: float) -> float:
    return min(max(value, -2.0), 2.0)
