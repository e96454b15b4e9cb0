"""Contact of an oriented box with walls and discs; boxes with boxes are in `dohyo.sumo_networks.geometry`."""

from __future__ import annotations

import math

from numba import njit

from dohyo.sumo_networks.arrays import FloatArray


@njit(cache=True)
def box_touches_segment(box: FloatArray, segment: FloatArray) -> bool:
    """Whether a closed box and a segment share a point (separating axes).

    Args:
        box: (5,) x, y [m], heading [rad], length, width [m].
        segment: (4,) x and y of both ends, m.
    """
    cos, sin = math.cos(box[2]), math.sin(box[2])
    x0, y0, x1, y1 = segment[0] - box[0], segment[1] - box[1], segment[2] - box[0], segment[3] - box[1]
    ahead0, ahead1 = x0 * cos + y0 * sin, x1 * cos + y1 * sin
    left0, left1 = y0 * cos - x0 * sin, y1 * cos - x1 * sin
    half_length, half_width = 0.5 * box[3], 0.5 * box[4]
    if min(ahead0, ahead1) > half_length or max(ahead0, ahead1) < -half_length:
        return False
    if min(left0, left1) > half_width or max(left0, left1) < -half_width:
        return False
    # The third axis is the normal of the segment.
    across = abs(ahead0 * left1 - left0 * ahead1)
    return bool(across <= half_length * abs(left1 - left0) + half_width * abs(ahead1 - ahead0))


@njit(cache=True)
def distance_to_box(box: FloatArray, x: float, y: float) -> float:
    """Distance of a point to a closed box, m; 0 inside.

    Args:
        box: (5,) x, y [m], heading [rad], length, width [m].
        x: Point, m.
        y: Point, m.
    """
    cos, sin = math.cos(box[2]), math.sin(box[2])
    dx, dy = x - box[0], y - box[1]
    beyond = max(abs(dx * cos + dy * sin) - 0.5 * box[3], 0.0)
    beside = max(abs(dy * cos - dx * sin) - 0.5 * box[4], 0.0)
    return math.hypot(beyond, beside)


@njit(cache=True)
def box_touches_disc(box: FloatArray, x: float, y: float, radius: float) -> bool:
    """Whether a closed box (5,) and a closed disc [m] share a point."""
    return distance_to_box(box, x, y) <= radius


@njit(cache=True)
def distance_to_segment(segment: FloatArray, x: float, y: float) -> float:
    """Distance of a point to a segment (4,), m."""
    ux, uy = segment[2] - segment[0], segment[3] - segment[1]
    dx, dy = x - segment[0], y - segment[1]
    squared = ux * ux + uy * uy
    t = min(max((dx * ux + dy * uy) / squared, 0.0), 1.0) if squared > 0.0 else 0.0
    return math.hypot(dx - t * ux, dy - t * uy)
