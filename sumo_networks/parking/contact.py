"""Contact of oriented boxes with boxes, walls and discs.

A *stored box* is a row of x, y [m], heading [rad], length, width [m], cosine and sine of the heading, and the radius of
the circle around it [m]: the box of `dohyo.sumo_networks.geometry` with what kernels would compute again and again.
"""

from __future__ import annotations

import math
from typing import Final

from numba import njit

from dohyo.sumo_networks.arrays import FloatArray

STORED: Final = 8


@njit(cache=True)
def store_box(boxes: FloatArray, number: int, x: float, y: float, heading: float, length: float, width: float) -> None:
    """Writes a row of (B, 8) stored boxes."""
    boxes[number, 0], boxes[number, 1], boxes[number, 2] = x, y, heading
    boxes[number, 3], boxes[number, 4] = length, width
    boxes[number, 5], boxes[number, 6] = math.cos(heading), math.sin(heading)
    boxes[number, 7] = 0.5 * math.hypot(length, width)


@njit(cache=True)
def boxes_touch(a: FloatArray, i: int, b: FloatArray, j: int) -> bool:
    """Whether two closed boxes, rows of (A, 8) and (B, 8) stored boxes, share a point (separating axes)."""
    dx, dy, reach = b[j, 0] - a[i, 0], b[j, 1] - a[i, 1], a[i, 7] + b[j, 7]
    if dx * dx + dy * dy > reach * reach:
        return False
    cos = abs(a[i, 5] * b[j, 5] + a[i, 6] * b[j, 6])
    sin = abs(a[i, 5] * b[j, 6] - a[i, 6] * b[j, 5])
    if abs(dx * a[i, 5] + dy * a[i, 6]) > 0.5 * (a[i, 3] + b[j, 3] * cos + b[j, 4] * sin):
        return False
    if abs(dy * a[i, 5] - dx * a[i, 6]) > 0.5 * (a[i, 4] + b[j, 3] * sin + b[j, 4] * cos):
        return False
    if abs(dx * b[j, 5] + dy * b[j, 6]) > 0.5 * (b[j, 3] + a[i, 3] * cos + a[i, 4] * sin):
        return False
    return not abs(dy * b[j, 5] - dx * b[j, 6]) > 0.5 * (b[j, 4] + a[i, 3] * sin + a[i, 4] * cos)


@njit(cache=True)
def touches_segment(boxes: FloatArray, number: int, wall: tuple[float, float, float, float]) -> bool:
    """Whether a closed box, a row of (B, 8), and a segment (x0, y0, x1, y1) [m] share a point (separating axes)."""
    x, y, radius = boxes[number, 0], boxes[number, 1], boxes[number, 7]
    x0, y0, x1, y1 = wall[0] - x, wall[1] - y, wall[2] - x, wall[3] - y
    if min(x0, x1) > radius or max(x0, x1) < -radius or min(y0, y1) > radius or max(y0, y1) < -radius:
        return False
    cos, sin = boxes[number, 5], boxes[number, 6]
    ahead0, ahead1 = x0 * cos + y0 * sin, x1 * cos + y1 * sin
    left0, left1 = y0 * cos - x0 * sin, y1 * cos - x1 * sin
    half_length, half_width = 0.5 * boxes[number, 3], 0.5 * boxes[number, 4]
    if min(ahead0, ahead1) > half_length or max(ahead0, ahead1) < -half_length:
        return False
    if min(left0, left1) > half_width or max(left0, left1) < -half_width:
        return False
    # The third axis is the normal of the segment.
    across = abs(ahead0 * left1 - left0 * ahead1)
    return bool(across <= half_length * abs(left1 - left0) + half_width * abs(ahead1 - ahead0))


@njit(cache=True)
def distance_to(boxes: FloatArray, number: int, x: float, y: float) -> float:
    """Distance of a point [m] to a closed box, a row of (B, 8), m; 0 inside."""
    dx, dy, cos, sin = x - boxes[number, 0], y - boxes[number, 1], boxes[number, 5], boxes[number, 6]
    beyond = max(abs(dx * cos + dy * sin) - 0.5 * boxes[number, 3], 0.0)
    beside = max(abs(dy * cos - dx * sin) - 0.5 * boxes[number, 4], 0.0)
    return math.hypot(beyond, beside)


@njit(cache=True)
def distance_to_segment(x0: float, y0: float, x1: float, y1: float, x: float, y: float) -> float:
    """Distance of a point to a segment, m."""
    ux, uy, dx, dy = x1 - x0, y1 - y0, x - x0, y - y0
    squared = ux * ux + uy * uy
    t = min(max((dx * ux + dy * uy) / squared, 0.0), 1.0) if squared > 0.0 else 0.0
    return math.hypot(dx - t * ux, dy - t * uy)
