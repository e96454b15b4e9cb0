"""Radar of the kart: nine rays from the centre of its box, each with distance and kind of what it meets.

Source: the thesis, +-60 degrees with a resolution of 15 degrees, 80 m. Spots are paint, and no ray meets them.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

import numpy as np
from numba import njit

from dohyo.sumo_networks.arrays import FloatArray, IntArray

RAYS: Final = 9
RANGE_M: Final = 80.0
BEARINGS_RAD: Final = np.radians(np.linspace(-60.0, 60.0, RAYS))
"""Bearing of each ray from the kart's heading, left positive."""


class Kind(IntEnum):
    """What a ray meets first."""

    NOTHING = 0
    WALL = 1
    CAR = 2
    KART = 3
    PEDESTRIAN = 4


_COS, _SIN = np.cos(BEARINGS_RAD), np.sin(BEARINGS_RAD)
PACKED: Final = 7
"""Columns of a packed box: x, y [m], cosine and sine of its heading, half length, half width, radius around it [m]."""


@njit(cache=True)
def pack_box(box: FloatArray, packed: FloatArray) -> None:
    """Writes a box (5,) as a packed box (7,)."""
    packed[0], packed[1] = box[0], box[1]
    packed[2], packed[3] = math.cos(box[2]), math.sin(box[2])
    packed[4], packed[5] = 0.5 * box[3], 0.5 * box[4]
    packed[6] = math.hypot(packed[4], packed[5])


@njit(cache=True)
def clear(distance: FloatArray, kind: IntArray) -> None:
    """Prepares (9,) distances and kinds for the functions below, which keep the nearest."""
    distance[:] = RANGE_M
    kind[:] = 0


@njit(cache=True, error_model="numpy")
def meet_wall(
    x: float, y: float, cos: float, sin: float, wall: FloatArray, distance: FloatArray, kind: IntArray
) -> None:
    """Lets the rays of a kart at x, y with a heading's cosine and sine meet a wall (4,)."""
    wx, wy = wall[2] - wall[0], wall[3] - wall[1]
    dx, dy = wall[0] - x, wall[1] - y
    reached = dx * wy - dy * wx
    # In the kart's frame, since the rays are constant there.
    wall_ahead, wall_left = wx * cos + wy * sin, wy * cos - wx * sin
    ahead, left = dx * cos + dy * sin, dy * cos - dx * sin
    for ray in range(RAYS):
        against = _COS[ray] * wall_left - _SIN[ray] * wall_ahead
        at = reached / against
        along = (ahead * _SIN[ray] - left * _COS[ray]) / against
        if 0.0 <= at < distance[ray] and 0.0 <= along <= 1.0:
            distance[ray], kind[ray] = at, 1


@njit(cache=True, error_model="numpy")
def meet_box(
    x: float, y: float, cos: float, sin: float, box: FloatArray, what: int, distance: FloatArray, kind: IntArray
) -> None:
    """Lets the rays meet a packed box (7,) of a kind."""
    dx, dy, radius = box[0] - x, box[1] - y, box[6]
    if dx * dx + dy * dy > (RANGE_M + radius) ** 2:
        return
    ahead, left = dx * cos + dy * sin, dy * cos - dx * sin
    # The box's frame, seen from the kart's: rotation by the difference of the headings.
    turn_cos, turn_sin = box[2] * cos + box[3] * sin, box[3] * cos - box[2] * sin
    start_ahead, start_left = -(ahead * turn_cos + left * turn_sin), -(left * turn_cos - ahead * turn_sin)
    for ray in range(RAYS):
        if abs(left * _COS[ray] - ahead * _SIN[ray]) > radius or ahead * _COS[ray] + left * _SIN[ray] < -radius:
            continue
        ray_ahead = _COS[ray] * turn_cos + _SIN[ray] * turn_sin
        ray_left = _SIN[ray] * turn_cos - _COS[ray] * turn_sin
        at = _slab(start_ahead, start_left, ray_ahead, ray_left, box[4], box[5])
        if at < distance[ray]:
            distance[ray], kind[ray] = at, what


@njit(cache=True, error_model="numpy")
def _slab(x: float, y: float, ux: float, uy: float, half_length: float, half_width: float) -> float:
    """Distance from x, y along u to a box around the origin; infinite: the ray misses it."""
    if abs(ux) < 1e-12:
        if abs(x) > half_length:
            return math.inf
        near, far = -math.inf, math.inf
    else:
        first, second = (-half_length - x) / ux, (half_length - x) / ux
        near, far = min(first, second), max(first, second)
    if abs(uy) < 1e-12:
        if abs(y) > half_width:
            return math.inf
    else:
        first, second = (-half_width - y) / uy, (half_width - y) / uy
        near, far = max(near, min(first, second)), min(far, max(first, second))
    if near > far or far < 0.0:
        return math.inf
    return max(near, 0.0)


@njit(cache=True)
def meet_disc(
    x: float,
    y: float,
    cos: float,
    sin: float,
    disc: tuple[float, float, float],
    what: int,
    distance: FloatArray,
    kind: IntArray,
) -> None:
    """Lets the rays meet a disc of x, y and radius [m] of a kind."""
    dx, dy, radius = disc[0] - x, disc[1] - y, disc[2]
    ahead, left = dx * cos + dy * sin, dy * cos - dx * sin
    for ray in range(RAYS):
        beside = left * _COS[ray] - ahead * _SIN[ray]
        inside = radius * radius - beside * beside
        if inside < 0.0:
            continue
        centre, half = ahead * _COS[ray] + left * _SIN[ray], math.sqrt(inside)
        if centre + half < 0.0:
            continue
        at = max(centre - half, 0.0)
        if at < distance[ray]:
            distance[ray], kind[ray] = at, what
