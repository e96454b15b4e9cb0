"""Curves of arcs and straight lines, as a kart with a bounded steering angle can drive them.

A curve is a (5, 2) array of segments: the steering (1 left, 0 straight, -1 right) and the signed length, negative in
reverse, in turning radii. Unused segments have length 0.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dohyo.sumo_networks.arrays import FloatArray

SEGMENTS = 5


@njit(cache=True)
def advanced(x: float, y: float, heading: float, steering: float, length: float) -> tuple[float, float, float]:
    """Pose at the end of a segment.

    Args:
        x: In turning radii, as all lengths.
        y: To the left of x.
        heading: Counter-clockwise from x, rad.
        steering: 1 left, 0 straight, -1 right.
        length: Signed, negative in reverse.
    """
    if steering == 0.0:
        return x + length * math.cos(heading), y + length * math.sin(heading), heading
    turned = heading + steering * length
    x += (math.sin(turned) - math.sin(heading)) / steering
    y -= (math.cos(turned) - math.cos(heading)) / steering
    return x, y, turned


@njit(cache=True)
def relative_to(start: FloatArray, goal: FloatArray, radius: float) -> tuple[float, float, float]:
    """Goal pose (x, y, heading) in the frame of the start, in turning radii and rad."""
    dx, dy = (goal[0] - start[0]) / radius, (goal[1] - start[1]) / radius
    cos, sin = math.cos(start[2]), math.sin(start[2])
    return cos * dx + sin * dy, cos * dy - sin * dx, goal[2] - start[2]


@njit(cache=True)
def wrapped(angle: float) -> float:
    """Angle in (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2.0 * math.pi)


@njit(cache=True)
def poses_along(start: FloatArray, curve: FloatArray, radius: float, step: float) -> FloatArray:
    """Poses on a curve, at most `step` apart, with both ends.

    Args:
        start: (3,) x, y [m] and heading [rad].
        curve: See the module.
        radius: Turning radius, m.
        step: m.

    Returns:
        (P, 5) x, y, heading, direction of travel (1 or -1) and steering of the segment that ends there.
    """
    count = 1
    for i in range(SEGMENTS):
        count += math.ceil(abs(curve[i, 1]) * radius / step)
    poses = np.empty((count, 5))
    poses[0, :3], poses[0, 3], poses[0, 4] = start, 1.0, 0.0
    x, y, heading, at = start[0] / radius, start[1] / radius, start[2], 1
    for i in range(SEGMENTS):
        steering, length = curve[i]
        pieces = math.ceil(abs(length) * radius / step)
        for piece in range(1, pieces + 1):
            px, py, turned = advanced(x, y, heading, steering, length * piece / pieces)
            poses[at, 0], poses[at, 1], poses[at, 2] = px * radius, py * radius, turned
            poses[at, 3], poses[at, 4] = (1.0 if length > 0.0 else -1.0), steering
            at += 1
        x, y, heading = advanced(x, y, heading, steering, length)
    poses[0, 3:] = poses[min(1, count - 1), 3:]
    return poses
