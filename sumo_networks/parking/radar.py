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


Eye = tuple[float, float, float, float]
"""Where a radar is: x, y [m], cosine and sine of its heading."""

PARALLEL: Final = 1e-12
"""A ray whose direction has a smaller component never leaves that side of a box."""
_WALL, _PEDESTRIAN = int(Kind.WALL), int(Kind.PEDESTRIAN)
_COS, _SIN = np.cos(BEARINGS_RAD), np.sin(BEARINGS_RAD)
_EDGE_COS, _EDGE_SIN = float(_COS[-1]), float(_SIN[-1])


@njit(cache=True, error_model="numpy")
def meet_wall(eye: Eye, walls: FloatArray, number: int, distance: FloatArray, kind: IntArray) -> None:
    """Lets the rays meet a wall, a row of (W, 4)."""
    x0, y0, x1, y1 = walls[number, 0], walls[number, 1], walls[number, 2], walls[number, 3]
    x, y, cos, sin = eye
    ahead, left = (x0 - x) * cos + (y0 - y) * sin, (y0 - y) * cos - (x0 - x) * sin
    wall_ahead, wall_left = (x1 - x0) * cos + (y1 - y0) * sin, (y1 - y0) * cos - (x1 - x0) * sin
    reached = ahead * wall_left - left * wall_ahead
    for ray in range(RAYS):
        # Cross products of ray, wall, and way to the wall's first point; a division only where the ray meets the wall.
        against = _COS[ray] * wall_left - _SIN[ray] * wall_ahead
        along = ahead * _SIN[ray] - left * _COS[ray]
        if against < 0.0:
            if along > 0.0 or along < against or reached > 0.0:
                continue
        elif along < 0.0 or along > against or reached < 0.0 or against == 0.0:
            continue
        at = reached / against
        if at < distance[ray]:
            distance[ray], kind[ray] = at, _WALL


@njit(cache=True)
def may_meet(eye: Eye, x: float, y: float, radius: float) -> bool:
    """Whether the outermost rays leave a circle [m] between them, or cut it."""
    dx, dy = x - eye[0], y - eye[1]
    ahead, left = dx * eye[2] + dy * eye[3], dy * eye[2] - dx * eye[3]
    return bool(abs(left) * _EDGE_COS - ahead * _EDGE_SIN <= radius)


@njit(cache=True, error_model="numpy")
def meet_box(eye: Eye, boxes: FloatArray, number: int, what: int, distance: FloatArray, kind: IntArray) -> None:
    """Lets the rays meet a box, a row of (B, 8) stored boxes, of a kind."""
    x, y, cos, sin = eye
    dx, dy, radius = boxes[number, 0] - x, boxes[number, 1] - y, boxes[number, 7]
    ahead, left = dx * cos + dy * sin, dy * cos - dx * sin
    # The box's frame, seen from the kart's: rotation by the difference of the headings.
    turn_cos = boxes[number, 5] * cos + boxes[number, 6] * sin
    turn_sin = boxes[number, 6] * cos - boxes[number, 5] * sin
    start_ahead, start_left = -(ahead * turn_cos + left * turn_sin), -(left * turn_cos - ahead * turn_sin)
    half_length, half_width = 0.5 * boxes[number, 3], 0.5 * boxes[number, 4]
    for ray in range(RAYS):
        if abs(left * _COS[ray] - ahead * _SIN[ray]) > radius or ahead * _COS[ray] + left * _SIN[ray] < -radius:
            continue
        ray_ahead = _COS[ray] * turn_cos + _SIN[ray] * turn_sin
        ray_left = _SIN[ray] * turn_cos - _COS[ray] * turn_sin
        at = _slab(start_ahead, start_left, ray_ahead, ray_left, half_length, half_width)
        if at < distance[ray]:
            distance[ray], kind[ray] = at, what


@njit(cache=True, error_model="numpy")
def _slab(x: float, y: float, ux: float, uy: float, half_length: float, half_width: float) -> float:
    """Distance from x, y along u to a box around the origin; infinite: the ray misses it."""
    near, far = 0.0, math.inf
    if abs(ux) >= PARALLEL:
        first, second = (-half_length - x) / ux, (half_length - x) / ux
        near, far = max(near, min(first, second)), max(first, second)
    elif abs(x) > half_length:
        return math.inf
    if abs(uy) >= PARALLEL:
        first, second = (-half_width - y) / uy, (half_width - y) / uy
        near, far = max(near, min(first, second)), min(far, max(first, second))
    elif abs(y) > half_width:
        return math.inf
    return near if near <= far else math.inf


@njit(cache=True)
def meet_disc(eye: Eye, disc: tuple[float, float, float], distance: FloatArray, kind: IntArray) -> None:
    """Lets the rays meet a pedestrian: x, y and radius, m."""
    x, y, cos, sin = eye
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
            distance[ray], kind[ray] = at, _PEDESTRIAN
