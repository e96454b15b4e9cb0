"""Tracker: pedals and steering that keep a kart on a path, and stop it where the path ends or is blocked."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit

from dohyo.agents.parking.expert.curves import wrapped
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.parking import kart

CRUISE_MPS: Final = 2.8
TURNING_MPS: Final = 1.8
DECELERATION_MPS2: Final = 1.2
GAINS: Final = (0.8, 1.6)
"""Curvature per lateral error [1/m^2] and per heading error [1/m]: a damped path error that fades within 2 m."""
SPEED_GAIN: Final = 2.5
"""Acceleration per speed error, 1/s."""
PREVIEW_S: Final = 0.25
"""Delay of the steering, which the path's curvature is read ahead by."""
AXLE_M: Final = 0.5 * kart.WHEELBASE_M
"""From the rear axle, which the paths are of, to the centre of the box."""

_PUSH: Final = kart.MAX_MOTOR_TORQUE_NM / (kart.WHEEL_RADIUS_M * kart.MASS_KG)
_HOLD: Final = kart.MAX_BRAKE_TORQUE_NM / (kart.WHEEL_RADIUS_M * kart.MASS_KG)
_ROLLING: Final = kart.ROLLING_RESISTANCE * kart.GRAVITY_MPS2


@njit(cache=True)
def rear_axle(body: FloatArray) -> FloatArray:
    """(3,) pose of the rear axle of a kart (7,)."""
    pose = np.empty(3)
    pose[0] = body[kart.X] - AXLE_M * math.cos(body[kart.HEADING])
    pose[1] = body[kart.Y] - AXLE_M * math.sin(body[kart.HEADING])
    pose[2] = body[kart.HEADING]
    return pose


@njit(cache=True)
def nearest(pose: FloatArray, path: FloatArray, at: int) -> int:
    """Index of the pose of a path (P, 5) that is nearest to the kart, from `at` on, before the next change of gear."""
    best = math.hypot(path[at, 0] - pose[0], path[at, 1] - pose[1])
    while at + 1 < len(path) and path[at + 1, 3] == path[at, 3]:
        away = math.hypot(path[at + 1, 0] - pose[0], path[at + 1, 1] - pose[1])
        if away > best:
            break
        best, at = away, at + 1
    return at


@njit(cache=True)
def left_over(pose: FloatArray, path: FloatArray, at: int) -> float:
    """Way to the end of the path, or to its next change of gear, m; negative behind it."""
    end, way = at, 0.0
    while end + 1 < len(path) and path[end + 1, 3] == path[at, 3]:
        way += math.hypot(path[end + 1, 0] - path[end, 0], path[end + 1, 1] - path[end, 1])
        end += 1
    cos, sin = math.cos(path[at, 2]), math.sin(path[at, 2])
    left: float = way - path[at, 3] * ((pose[0] - path[at, 0]) * cos + (pose[1] - path[at, 1]) * sin)
    return left


@njit(cache=True)
def steer(pose: FloatArray, speed: float, path: FloatArray, at: int, radius: float) -> float:
    """Steering angle as a share of its maximum, for a path whose arcs have a turning radius [m]."""
    ahead, way = at, abs(speed) * PREVIEW_S
    while way > 0.0 and ahead + 1 < len(path) and path[ahead + 1, 3] == path[at, 3]:
        way -= math.hypot(path[ahead + 1, 0] - path[ahead, 0], path[ahead + 1, 1] - path[ahead, 1])
        ahead += 1
    dx, dy = pose[0] - path[at, 0], pose[1] - path[at, 1]
    cos, sin = math.cos(path[at, 2]), math.sin(path[at, 2])
    lateral, past = dy * cos - dx * sin, dx * cos + dy * sin
    turned = wrapped(pose[2] - path[at, 2] - past * path[at, 4] / radius)
    curvature = path[ahead, 4] / radius - GAINS[0] * lateral - path[at, 3] * GAINS[1] * turned
    share = math.atan(curvature * kart.WHEELBASE_M) / kart.MAX_STEERING_RAD
    return min(max(share, -1.0), 1.0)


@njit(cache=True)
def pedals(speed: float, wanted: float) -> tuple[float, float]:
    """Motor and brake as shares of their maxima, for a wanted speed [m/s], both signed."""
    direction = 1.0 if wanted > 0.0 or (wanted == 0.0 and speed >= 0.0) else -1.0
    now, then = direction * speed, direction * wanted
    if then <= 0.0 or now < -0.05:
        return 0.0, 1.0
    change = SPEED_GAIN * (then - now)
    if change < -_ROLLING:
        return 0.0, min(-change / _HOLD, 1.0)
    fading = max(1.0 - max(now, 0.0) / kart.MAX_SPEED_MPS, 0.1)
    return direction * min(max(change + _ROLLING, 0.0) / (_PUSH * fading), 1.0), 0.0


@njit(cache=True)
def follow(body: FloatArray, path: FloatArray, at: int, radius: float, free_m: float) -> tuple[FloatArray, int]:
    """Action of a kart on a path.

    Args:
        body: (7,) state of the kart.
        path: (P, 5) of its rear axle, see `curves.poses_along`.
        at: Result of the last call; 0 at the start.
        radius: Turning radius of the path's arcs, m.
        free_m: Way that is free ahead.

    Returns:
        (3,) action, and the index of the nearest pose.
    """
    pose, action = rear_axle(body), np.zeros(3)
    at = nearest(pose, path, at)
    left = left_over(pose, path, at)
    speed = body[kart.SPEED]
    if left < 0.08 and at + 1 < len(path) and path[at + 1, 3] != path[at, 3] and abs(speed) < 0.1:
        at = nearest(pose, path, at + 1)
        left = left_over(pose, path, at)
    most = TURNING_MPS if abs(path[at, 4]) > 0.0 else CRUISE_MPS
    stop_in = max(min(left, free_m) - PREVIEW_S * abs(speed) / 2.0, 0.0)
    wanted = min(most, math.sqrt(2.0 * DECELERATION_MPS2 * stop_in))
    action[0], action[2] = pedals(speed, path[at, 3] * wanted)
    action[1] = steer(pose, speed, path, at, radius)
    return action, at
