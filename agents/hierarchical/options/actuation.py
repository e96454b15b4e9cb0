"""Actuation: maps a sub-policy's two numbers in [-1, 1] to controls, and an expert's controls back."""

from __future__ import annotations

import math
from enum import StrEnum

import numpy as np

from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.ego.control import pure_pursuit, pursuit_distance
from dohyo.sumo_networks.ego.dynamics import VehicleParameters

ACTIONS = 2
ACCELERATION_M_S2 = 8.0
"""Full pedals in both directions, m/s^2: a policy may brake as hard as the rules, and symmetric noise neither speeds up
nor brakes on average."""
SIDE_M_S2 = 3.5
"""Lateral acceleration of full steering, m/s^2: a step of the policy has the same effect at any speed."""
RESIDUAL_SHARE = 0.3
STANDS_M_S, RELEASE_M_S2, HOLD_M_S2 = 0.1, 1.0, -2.0
"""Pedal above which a standing car starts, m/s^2: otherwise noise around 0 would creep over every line."""
_CAR = VehicleParameters()


class Steering(StrEnum):
    """Steering by the policy alone, or by pure pursuit with the policy's correction (ours)."""

    POLICY = "policy"
    RESIDUAL = "residual"


def command(action: Float32Array, speed: float, route: Float32Array, steering: Steering) -> FloatArray:
    """The control "acceleration_steering" of an action.

    Args:
        action: (2,) pedals and steering in [-1, 1], left positive.
        speed: m/s.
        route: (80, 7), the path that is followed; see `sensors.route`.
        steering: Kind of steering.

    Returns:
        (2,) acceleration [m/s^2] and steering in [-1, 1] of full lock.
    """
    pedals, wheel = (min(max(float(v), -1.0), 1.0) for v in action)
    angle = wheel * steering_limit(speed)
    if steering is Steering.RESIDUAL:
        angle = _pursuit(route, speed) + RESIDUAL_SHARE * angle
    acceleration = pedals * ACCELERATION_M_S2
    if speed < STANDS_M_S and acceleration < RELEASE_M_S2:
        acceleration = min(acceleration, HOLD_M_S2)
    return np.array([acceleration, min(max(angle / _CAR.max_steering, -1.0), 1.0)])


def action_of(controls: FloatArray, speed: float, route: Float32Array, steering: Steering) -> Float32Array:
    """Action in [-1, 1] nearest to given controls; the inverse of `command`."""
    angle = float(controls[1]) * _CAR.max_steering
    limit = steering_limit(speed)
    if steering is Steering.RESIDUAL:
        angle, limit = angle - _pursuit(route, speed), RESIDUAL_SHARE * limit
    pedals = min(max(float(controls[0]) / ACCELERATION_M_S2, -1.0), 1.0)
    return np.array([pedals, min(max(angle / limit, -1.0), 1.0)], dtype=np.float32)


def steering_limit(speed: float) -> float:
    """Front wheel angle of full steering, rad: full lock, or the bend that needs 3.5 m/s^2 to the side."""
    return min(_CAR.max_steering, math.atan(_CAR.wheelbase * SIDE_M_S2 / max(speed, 0.1) ** 2))


def _pursuit(route: Float32Array, speed: float) -> float:
    aim = route[round(pursuit_distance(speed))]
    return pure_pursuit(_CAR, float(aim[0]), float(aim[1]))
