"""Path behind: the route's path further back than the sensor shows it, along the lanes that the route came by.

Who comes from behind at speed is 30 m away or more when it matters to an ego that changes lanes, and on a bend he is
not where a straight line would have him.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.sensors.lanes import ATTRIBUTES, FOLLOWERS, POINTS

FURTHER_M = 48
"""Metres by which a path is continued, a row each."""
_OWN = 2.0
_NEAR_M = 1.0


@njit(cache=True)
def continued(path: FloatArray, lanes: Float32Array) -> FloatArray:
    """(48 + P, 6) the path, begun 48 m further back; straight on where no lane of the route leads there.

    Args:
        path: (P, 6), see `sensors.path`. Rows that repeat its first point before the start are replaced, too.
        lanes: (160, 52), see `sensors.lanes`.
    """
    first = 0
    while first < path.shape[0] - 2 and path[first, 0] == path[first + 1, 0] and path[first, 1] == path[first + 1, 1]:
        first += 1
    count = FURTHER_M + first
    out = np.empty((FURTHER_M + path.shape[0], 6))
    out[count:] = path[first:]
    x, y, cos, sin = path[first, 0], path[first, 1], math.cos(path[first, 2]), math.sin(path[first, 2])
    row, point = _piece_at(lanes, x, y, cos, sin)
    for n in range(count - 1, -1, -1):
        left = 1.0
        while row >= 0:
            dx = lanes[row, ATTRIBUTES + 2 * point] - x
            dy = lanes[row, ATTRIBUTES + 2 * point + 1] - y
            step = math.hypot(dx, dy)
            if step >= left:
                cos, sin = -dx / step, -dy / step
                break
            x, y, left = x + dx, y + dy, left - step
            row, point = _before(lanes, row, point)
        x, y = x - left * cos, y - left * sin
        out[n] = path[first]
        out[n, 0], out[n, 1], out[n, 2], out[n, 3] = x, y, math.atan2(sin, cos), 0.0
    return out


@njit(cache=True)
def _piece_at(lanes: Float32Array, x: float, y: float, cos: float, sin: float) -> tuple[int, int]:
    """Row of the piece of the route that leads through a place in a direction, and its last point before that."""
    best, found, point = _NEAR_M, -1, -1
    for row in range(lanes.shape[0]):
        if lanes[row, 0] < 0:
            break
        if lanes[row, 5] != _OWN:
            continue
        for p in range(POINTS - 1):
            ax, ay = lanes[row, ATTRIBUTES + 2 * p], lanes[row, ATTRIBUTES + 2 * p + 1]
            ux, uy = lanes[row, ATTRIBUTES + 2 * p + 2] - ax, lanes[row, ATTRIBUTES + 2 * p + 3] - ay
            length = math.hypot(ux, uy)
            if length < 1e-6 or ux * cos + uy * sin < 0.7 * length:
                continue
            along = ((x - ax) * ux + (y - ay) * uy) / length
            aside = abs((y - ay) * ux - (x - ax) * uy) / length
            if -0.01 <= along <= length + 0.01 and aside < best:
                best, found, point = aside, row, p
    return found, point


@njit(cache=True)
def _before(lanes: Float32Array, row: int, point: int) -> tuple[int, int]:
    """The point before one of a piece, on the piece before it where it is the first; -1, -1 where none is known."""
    if point > 0:
        return row, point - 1
    lane, piece = lanes[row, 0], lanes[row, 1]
    for other in range(lanes.shape[0]):
        if lanes[other, 0] < 0:
            break
        if lanes[other, 5] != _OWN:
            continue
        leads = piece > 0 and lanes[other, 0] == lane and lanes[other, 1] == piece - 1
        if piece == 0:
            for column in range(ATTRIBUTES - FOLLOWERS, ATTRIBUTES):
                leads |= lanes[other, column] == lane
        if leads:
            return other, POINTS - 1
    return -1, -1
