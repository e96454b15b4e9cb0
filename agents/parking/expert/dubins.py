"""Shortest curve that drives forwards only (Dubins 1957)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dohyo.agents.parking.expert.curves import SEGMENTS
from dohyo.sumo_networks.arrays import FloatArray

_TURN = 2.0 * math.pi


@njit(cache=True)
def dubins(x: float, y: float, heading: float) -> tuple[float, FloatArray]:
    """Length of the shortest curve to a pose, and the curve; frame and unit are those of `relative_to`."""
    best, curve = math.inf, np.zeros((SEGMENTS, 2))
    for first in (1.0, -1.0):
        for last in (1.0, -1.0):
            t, p, q = _straight_between(x, y, heading, first, last)
            if t + p + q < best:
                best = t + p + q
                curve[0], curve[1], curve[2] = (first, t), (0.0, p), (last, q)
        t, p, q = _arc_between(x, y, heading, first)
        if t + p + q < best:
            best = t + p + q
            curve[0], curve[1], curve[2] = (first, t), (-first, p), (first, q)
    return best, curve


@njit(cache=True)
def _centres(x: float, y: float, heading: float, first: float, last: float) -> tuple[float, float]:
    """Distance and direction from the centre of the first circle to that of the last one."""
    dx = x - last * math.sin(heading)
    dy = y + last * math.cos(heading) - first
    return math.hypot(dx, dy), math.atan2(dy, dx)


@njit(cache=True)
def _straight_between(x: float, y: float, heading: float, first: float, last: float) -> tuple[float, float, float]:
    """Lengths of arc, tangent and arc; infinite where the circles have no such tangent."""
    distance, direction = _centres(x, y, heading, first, last)
    if first == last:
        tangent, course = distance, direction
    elif distance < 2.0:
        return math.inf, 0.0, 0.0
    else:
        tangent = math.sqrt(distance * distance - 4.0)
        course = direction + first * math.atan2(2.0, tangent)
    return (first * course) % _TURN, tangent, (last * (heading - course)) % _TURN


@njit(cache=True)
def _arc_between(x: float, y: float, heading: float, first: float) -> tuple[float, float, float]:
    """Lengths of three arcs, the second to the other side; infinite where the circles are too far apart."""
    distance, direction = _centres(x, y, heading, first, first)
    if distance > 4.0:
        return math.inf, 0.0, 0.0
    middle = _TURN - 2.0 * math.asin(distance / 4.0)  # more than pi, which the shortest curve of this kind has
    # The middle circle's centre is at +-acos(d / 4) from the line between the centres.
    t = (first * direction + math.pi / 2.0 + math.acos(distance / 4.0)) % _TURN
    turned = first * (t - middle)
    return t, middle, (first * (heading - turned)) % _TURN
