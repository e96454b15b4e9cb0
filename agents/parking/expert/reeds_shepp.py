"""Shortest curve that may drive in reverse (Reeds and Shepp 1990, by the words of section 8 of their article).

Eight words with three unknown lengths, each to the left first and forwards first. The other curves follow by symmetry:
driven in the other direction, mirrored, or from the goal to the start.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dohyo.agents.parking.expert.curves import SEGMENTS, wrapped
from dohyo.sumo_networks.arrays import FloatArray

WORDS = np.array(
    [
        [1, 0, 1, 0, 0],
        [1, 0, -1, 0, 0],
        [1, -1, 1, 0, 0],
        [1, -1, 1, -1, 0],
        [1, -1, 1, -1, 0],
        [1, -1, 0, 1, 0],
        [1, -1, 0, -1, 0],
        [1, -1, 0, 1, -1],
    ],
    dtype=np.float64,
)
"""Steering of each segment of each word."""
_QUARTER, _NOTHING = math.pi / 2.0, (math.inf, 0.0, 0.0, 0.0, 0.0)
_Lengths = tuple[float, float, float, float, float]


@njit(cache=True)
def reeds_shepp(x: float, y: float, heading: float) -> tuple[float, FloatArray]:
    """Length of the shortest curve to a pose, and the curve; frame and unit are those of `relative_to`."""
    heading = wrapped(heading)
    best, curve = math.inf, np.zeros((SEGMENTS, 2))
    for back in (False, True):
        to_x, to_y = x, y
        if back:  # the start, seen from the goal, with both driven in reverse
            cos, sin = math.cos(heading), math.sin(heading)
            to_x, to_y = x * cos + y * sin, x * sin - y * cos
        for direction in (1.0, -1.0):
            for side in (1.0, -1.0):
                for word in range(len(WORDS)):
                    found = _lengths(word, direction * to_x, side * to_y, direction * side * heading)
                    total = abs(found[0]) + abs(found[1]) + abs(found[2]) + abs(found[3]) + abs(found[4])
                    if total < best - 1e-12:
                        best = total
                        _write(curve, word, found, direction, side, back)
    return best, curve


@njit(cache=True)
def _write(curve: FloatArray, word: int, lengths: _Lengths, direction: float, side: float, back: bool) -> None:
    last = 4 if WORDS[word, 4] != 0.0 else 3 if WORDS[word, 3] != 0.0 else 2
    curve[:] = 0.0
    for i, length in enumerate(lengths):
        if i <= last:
            at = last - i if back else i
            curve[at, 0], curve[at, 1] = side * WORDS[word, i], direction * length


@njit(cache=True)
def _lengths(word: int, x: float, y: float, phi: float) -> _Lengths:
    """Lengths of a word's segments to the pose (x, y, phi); the first one is infinite if it does not lead there."""
    sin, cos = math.sin(phi), math.cos(phi)
    same, other = (x - sin, y - 1.0 + cos), (x + sin, y - 1.0 - cos)  # between centres on the same, on other sides
    if word == 0:
        return _lsl(same, phi)
    if word == 1:
        return _lsr(other, phi)
    if word == 2:
        return _lrl(same, phi)
    if word == 3:
        return _lrlr_inner(other, phi)
    if word == 4:
        return _lrlr_outer(other, phi)
    if word == 5:
        return _lrsl(same, phi)
    if word == 6:
        return _lrsr(other, phi)
    return _lrslr(other, phi)


@njit(cache=True)
def _lsl(to: tuple[float, float], phi: float) -> _Lengths:
    t = math.atan2(to[1], to[0])
    v = wrapped(phi - t)
    return (t, math.hypot(to[0], to[1]), v, 0.0, 0.0) if t >= 0.0 and v >= 0.0 else _NOTHING


@njit(cache=True)
def _lsr(to: tuple[float, float], phi: float) -> _Lengths:
    square = to[0] * to[0] + to[1] * to[1]
    if square < 4.0:
        return _NOTHING
    u = math.sqrt(square - 4.0)
    t = wrapped(math.atan2(to[1], to[0]) + math.atan2(2.0, u))
    v = wrapped(t - phi)
    return (t, u, v, 0.0, 0.0) if t >= 0.0 and v >= 0.0 else _NOTHING


@njit(cache=True)
def _lrl(to: tuple[float, float], phi: float) -> _Lengths:
    """The third arc's direction is free, which covers two words."""
    distance = math.hypot(to[0], to[1])
    if distance > 4.0:
        return _NOTHING
    u = -2.0 * math.asin(0.25 * distance)
    t = wrapped(math.atan2(to[1], to[0]) + 0.5 * u + math.pi)
    return (t, u, wrapped(phi - t + u), 0.0, 0.0) if t >= 0.0 else _NOTHING


@njit(cache=True)
def _outer_arcs(u: float, v: float, to: tuple[float, float], phi: float) -> tuple[float, float]:
    """First and last arc of LRLR, whose arcs in the middle are u and v."""
    delta = wrapped(u - v)
    a, b = math.sin(u) - math.sin(delta), math.cos(u) - math.cos(delta) - 1.0
    t = math.atan2(to[1] * a - to[0] * b, to[0] * a + to[1] * b)
    if 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0 < 0.0:
        t += math.pi
    t = wrapped(t)
    return t, wrapped(t - u + v - phi)


@njit(cache=True)
def _lrlr_inner(to: tuple[float, float], phi: float) -> _Lengths:
    """Forwards twice, then in reverse twice."""
    rho = 0.25 * (2.0 + math.hypot(to[0], to[1]))
    if rho > 1.0:
        return _NOTHING
    u = math.acos(rho)
    t, v = _outer_arcs(u, -u, to, phi)
    return (t, u, -u, v, 0.0) if t >= 0.0 and v <= 0.0 else _NOTHING


@njit(cache=True)
def _lrlr_outer(to: tuple[float, float], phi: float) -> _Lengths:
    """Forwards, in reverse twice, and forwards."""
    rho = (20.0 - to[0] * to[0] - to[1] * to[1]) / 16.0
    if not 0.0 <= rho <= 1.0:
        return _NOTHING
    u = -math.acos(rho)
    t, v = _outer_arcs(u, u, to, phi)
    return (t, u, u, v, 0.0) if t >= 0.0 and v >= 0.0 else _NOTHING


@njit(cache=True)
def _lrsl(to: tuple[float, float], phi: float) -> _Lengths:
    distance = math.hypot(to[0], to[1])
    if distance < 2.0:
        return _NOTHING
    tangent = math.sqrt(distance * distance - 4.0)
    u = 2.0 - tangent
    t = wrapped(math.atan2(to[1], to[0]) + math.atan2(tangent, -2.0))
    v = wrapped(phi - _QUARTER - t)
    return (t, -_QUARTER, u, v, 0.0) if t >= 0.0 and u <= 0.0 and v <= 0.0 else _NOTHING


@njit(cache=True)
def _lrsr(to: tuple[float, float], phi: float) -> _Lengths:
    distance = math.hypot(to[0], to[1])
    if distance < 2.0:
        return _NOTHING
    t = math.atan2(to[0], -to[1])
    u, v = 2.0 - distance, wrapped(t + _QUARTER - phi)
    return (t, -_QUARTER, u, v, 0.0) if t >= 0.0 and u <= 0.0 and v <= 0.0 else _NOTHING


@njit(cache=True)
def _lrslr(to: tuple[float, float], phi: float) -> _Lengths:
    distance = math.hypot(to[0], to[1])
    if distance < 2.0:
        return _NOTHING
    u = 4.0 - math.sqrt(distance * distance - 4.0)
    if u > 0.0:
        return _NOTHING
    t = wrapped(math.atan2((4.0 - u) * to[0] - 2.0 * to[1], -2.0 * to[0] + (u - 4.0) * to[1]))
    v = wrapped(t - phi)
    return (t, -_QUARTER, u, -_QUARTER, v) if t >= 0.0 and v >= 0.0 else _NOTHING
