"""Control: two PIDs turn waypoints into pedals and steering; an ego that stands too long creeps.

Source: Coelho 2024, section 5.3, and the gains of its code, which runs at 20 Hz, ours at 10 Hz. A steering of 1 turns
its wheels by 70 degrees, and ours by `VehicleParameters.max_steering`, so that the gains are scaled. The brake grows
with the excess of speed, where the code's is full.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np

from dohyo.agents.priboot.recording.dataset import WAYPOINT_S
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters

STEER_SHARE: Final = 0.4
"""Of the scaled gains of the steering: with all of them the ego swings by 0.5 m about its route at 8 m/s."""
STANDSTILL_M_S, EXCESS = 0.4, 1.1
"""Desired speed below which it brakes, and ratio of the speed to the desired one above which it does."""
SPEED_ERROR_M_S, THROTTLE = 0.25, 0.75
"""Largest error that the speed's PID sees, and largest throttle."""
FULL_BRAKE_M_S, HOLD = 2.5, 0.3
"""Excess of speed at which the brake is full, and least brake where it is to stand."""
CREEP_AFTER_S, CREEP_S, CREEP_M_S = 10.0, 1.5, 1.5
STRAIGHT_M, STRAIGHT_RAD = 2.5, math.radians(15.0)
"""Length of the way that must be straight before the ego creeps, and largest angle to its end."""


class Pid:
    """PID over a window of errors, in steps of one tick."""

    def __init__(self, proportional: float, integral: float, derivative: float, window: int = 20) -> None:
        self._gains, self._errors = (proportional, integral, derivative), deque[float](maxlen=window)

    def __call__(self, error: float) -> float:
        """Output for the next error."""
        self._errors.append(error)
        slope = self._errors[-1] - self._errors[-2] if len(self._errors) > 1 else 0.0
        terms = (error, sum(self._errors) / len(self._errors), slope)
        return sum(gain * term for gain, term in zip(self._gains, terms, strict=True))


class WaypointControl:
    """Pedals and steering of one ego.

    Attributes:
        creeping: Whether it creeps.
    """

    def __init__(self) -> None:
        scale = math.radians(70.0) / VehicleParameters().max_steering
        scale *= STEER_SHARE
        self._steer = Pid(1.75 * scale, 0.75 * scale, 0.3 * scale)
        self._speed = Pid(5.0, 0.5, 1.0)
        self._creep_s, self.creeping = 0.0, False

    def pedals(self, waypoints: FloatArray, speed: float, creeps: bool) -> FloatArray:
        """(3,) throttle, brake and steering.

        Args:
            waypoints: (4, 2) in the ego's frame, m.
            speed: m/s.
            creeps: Whether a short push begins now.
        """
        wanted = float(np.linalg.norm(np.diff(waypoints, axis=0), axis=1).mean()) / WAYPOINT_S
        wanted = self._crept(wanted, creeps)
        aim = waypoints[:2].mean(axis=0)
        # A point beside a car that stands has no direction.
        angle = math.atan2(aim[1], aim[0]) if math.hypot(*aim) > 0.3 and aim[0] > 0.0 else 0.0
        steering = min(max(self._steer(math.degrees(angle) / 90.0), -1.0), 1.0)
        throttle = self._speed(min(max(wanted - speed, 0.0), SPEED_ERROR_M_S))
        if wanted < STANDSTILL_M_S or speed > EXCESS * wanted:
            least = HOLD if wanted < STANDSTILL_M_S else 0.0
            return np.array([0.0, min(max((speed - wanted) / FULL_BRAKE_M_S, least), 1.0), steering])
        return np.array([min(max(throttle, 0.0), THROTTLE), 0.0, steering])

    def _crept(self, wanted: float, creeps: bool) -> float:
        """Desired speed: a short push after a long standstill."""
        if creeps:
            self._creep_s = CREEP_S
        self.creeping = self._creep_s > 0.0
        self._creep_s = max(self._creep_s - 0.1, 0.0)
        return max(wanted, CREEP_M_S) if self.creeping else wanted
