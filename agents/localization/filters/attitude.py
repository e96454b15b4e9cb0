"""Attitude: unit quaternions w, x, y, z (Hamilton) that turn vectors of the body into the navigation frame.

Source: Sola 2017, Quaternion kinematics for the error-state Kalman filter.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dohyo.sumo_networks.arrays import FloatArray


@njit(cache=True)
def product(p: FloatArray, q: FloatArray) -> FloatArray:
    """(4,) Hamilton product: first q, then p."""
    out = np.empty(4)
    out[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    out[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    out[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    out[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]
    return out


@njit(cache=True)
def exponential(rotation: FloatArray) -> FloatArray:
    """(4,) the quaternion of a rotation vector (3,), rad."""
    angle = math.sqrt(rotation[0] ** 2 + rotation[1] ** 2 + rotation[2] ** 2)
    # sin(x / 2) / x; its series where the division would lose digits
    scale = math.sin(0.5 * angle) / angle if angle > 1e-4 else 0.5 - angle * angle / 48.0
    out = np.empty(4)
    out[0] = math.cos(0.5 * angle)
    out[1:] = scale * rotation
    return out


@njit(cache=True)
def logarithm(q: FloatArray) -> FloatArray:
    """(3,) the rotation vector of a quaternion, rad, at most pi long."""
    sign = 1.0 if q[0] >= 0.0 else -1.0
    length = math.sqrt(q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    scale = 2.0 * math.atan2(length, sign * q[0]) / length if length > 1e-10 else 2.0
    return sign * scale * q[1:]


@njit(cache=True)
def normalised(q: FloatArray) -> FloatArray:
    """(4,) the quaternion at length 1."""
    return q / math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)


@njit(cache=True)
def inverse(q: FloatArray) -> FloatArray:
    """(4,) the rotation back, of a unit quaternion."""
    return np.array([q[0], -q[1], -q[2], -q[3]])


@njit(cache=True)
def matrix(q: FloatArray) -> FloatArray:
    """(3, 3) the rotation matrix, body to navigation frame, of a unit quaternion."""
    w, x, y, z = q
    out = np.empty((3, 3))
    out[0, 0], out[0, 1], out[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[1, 0], out[1, 1], out[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[2, 0], out[2, 1], out[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return out


@njit(cache=True)
def skew(v: FloatArray) -> FloatArray:
    """(3, 3) the matrix that takes the cross product with v from the left."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


@njit(cache=True)
def from_heading(heading: float) -> FloatArray:
    """(4,) level, and turned by a heading, rad counter-clockwise from east."""
    return np.array([math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading)])


@njit(cache=True)
def heading_of(q: FloatArray) -> float:
    """Heading, rad counter-clockwise from east, in [-pi, pi]."""
    return math.atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))
