"""Disturbance: what takes an ego from its demonstrator's way, so that a learner sees how to come back. Ours."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.control import AccelerationSteering
from dohyo.sumo_networks.sensors import Observation
from dohyo.sumo_networks.units import TICK_S

SWERVE_S, STALL_S, PAUSE_S = (0.5, 1.2), (1.0, 9.0), (4.0, 9.0)
"""Shortest and longest swerve, stall, and pause after either."""
LATE_S, STOP_S = (1.0, 5.0), 1.5
"""Shortest and longest late start, and how long an ego has stood before one."""
STANDING_M_S, STARTS = 0.2, 0.5
"""Speed below which an ego stands, and acceleration from which on the expert goes on [m/s^2]."""
STEERING, TURN_M_S, ACCELERATION = 0.2, 0.8, 1.0
"""Of a swerve: largest noise on the steering [of full lock]; above 4 m/s this over the speed [m/s]; on the acceleration
[m/s^2]."""
STALL = (-5.0, -2.0)
"""Acceleration of a stall, m/s^2."""


class Disturbance(Protocol):
    """What takes an ego from where its demonstrator would be.

    Attributes:
        active: Whether the last action was disturbed.
        stalls: Whether that held an ego which could go.
        told_s: For how long an ego is said to have stood that is held until its demonstrator would go; None: none is.
    """

    active: bool
    stalls: bool
    told_s: float | None

    def disturbed(self, action: FloatArray, speed: float, observation: Observation) -> FloatArray:
        """(2,) acceleration and steering that the ego drives, given the demonstrator's."""


class Bursts:
    """Swerves, stalls and late starts, with pauses in which the expert comes back.

    A swerve adds noise to pedal and steering. A stall brakes for no reason, and holds an ego that stands; a late start
    holds one that could go on after a stop. Both are there since a learner that only sees egos that stand for a reason
    learns that an ego that stands goes on standing.

    Attributes:
        active: Whether the last action was disturbed.
        stalls: Whether it was by a stall or a late start.
        told_s: None.
    """

    told_s: float | None = None

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng, self.active, self.stalls = rng, False, False
        self._left, self._stood = round(rng.uniform(*PAUSE_S) / TICK_S), 0
        self._noise, self._brakes = np.zeros(2), 0.0

    def disturbed(self, action: FloatArray, speed: float, observation: Observation) -> FloatArray:
        """Disturbed acceleration and steering of one tick."""
        late = self._starts_late(action, speed)
        if self._left == 0 or late:
            self._turn(late, speed)
        self._left -= 1
        if not self.active:
            return action
        if self.stalls:
            return np.array([min(action[0], self._brakes), action[1]])
        obeys = action[0] < -1.0  # lights that are obeyed must be recorded
        noisy = action + self._noise * (not obeys, 1.0)
        return np.asarray(np.clip(noisy, AccelerationSteering.space.low, AccelerationSteering.space.high))

    def _starts_late(self, action: FloatArray, speed: float) -> bool:
        """Whether a late start begins: for half of the times that the expert goes on after a stop."""
        if speed >= STANDING_M_S or self.active:
            self._stood = 0
            return False
        self._stood += 1
        if action[0] < STARTS or self._stood * TICK_S < STOP_S:
            return False
        self._stood = 0
        return bool(self._rng.random() < 0.5)

    def _turn(self, late: bool, speed: float) -> None:
        """Ends or begins a disturbance."""
        self.active = late or not self.active
        self.stalls = self.active and (late or bool(self._rng.random() < 0.5))
        lasts = LATE_S if late else (STALL_S if self.stalls else SWERVE_S) if self.active else PAUSE_S
        self._left = round(self._rng.uniform(*lasts) / TICK_S)
        self._noise = self._rng.uniform(-1.0, 1.0, 2) * (ACCELERATION, min(STEERING, TURN_M_S / max(speed, 1.0)))
        self._brakes = self._rng.uniform(*STALL)
