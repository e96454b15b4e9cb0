"""Displacement: the world as it would look if one ego stood elsewhere, and noise that takes an ego off its lane.

A learner that only sees the middle of the lane never learns to come back to it. Thesis B shifts and turns the ego in
the view, and its waypoints with it. Here the view is drawn anew from the displaced pose, so that it is exact.

Source: Coelho 2024, section 5.3 (augmentation, after LBC); sizes are those of its code, whose units are not stated: we
read the angle in degrees and the others in metres, and shorten the first from 5 to 0.5. The noise is ours.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.control import AccelerationSteering
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import World

AHEAD_M, ASIDE_M, TURN_RAD = 0.5, 1.0, math.radians(10.0)
"""Largest displacement."""
MOVING_M_S = 0.5
"""Slower egos are not displaced: a car that stands cannot come back."""
SWERVE_S, STALL_S, PAUSE_S = (0.5, 1.2), (1.0, 3.0), (4.0, 9.0)
"""Shortest and longest swerve, stall, and pause after either."""
STEERING, TURN_M_S, ACCELERATION = 0.2, 0.8, 1.0
"""Of a swerve: largest noise on the steering [of full lock]; above 4 m/s this over the speed [m/s]; on the acceleration
[m/s^2]."""
STALL = (-5.0, -2.0)
"""Acceleration of a stall, m/s^2."""


def drawn_displacement(rng: np.random.Generator) -> FloatArray:
    """(3,) ahead, to the left [m] and turn [rad], each uniform within its bounds."""
    return np.asarray(rng.uniform(-1.0, 1.0, 3) * (AHEAD_M, ASIDE_M, TURN_RAD))


def displaced(world: World, ego: int, by: FloatArray) -> World:
    """The world with one ego displaced in its own frame; all else stays."""
    position, heading = world.egos.position.copy(), world.egos.heading.copy()
    cos, sin = math.cos(heading[ego]), math.sin(heading[ego])
    position[ego] += (by[0] * cos - by[1] * sin, by[0] * sin + by[1] * cos)
    heading[ego] += by[2]
    return dataclasses.replace(world, egos=dataclasses.replace(world.egos, position=position, heading=heading))


class Bursts:
    """Swerves and stalls, with pauses in which the expert comes back.

    A swerve adds noise to pedal and steering. A stall brakes for no reason, also to a standstill: who only sees egos
    that stand for a reason learns that an ego that stands goes on standing.

    Attributes:
        active: Whether the last action was disturbed.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng, self.active = rng, False
        self._left = round(rng.uniform(*PAUSE_S) / TICK_S)
        self._noise, self._stalls, self._brakes = np.zeros(2), False, 0.0

    def disturbed(self, action: FloatArray, speed: float) -> FloatArray:
        """Disturbed acceleration and steering of one tick."""
        if self._left == 0:
            self.active = not self.active
            self._stalls = self.active and bool(self._rng.random() < 0.5)
            lasts = (STALL_S if self._stalls else SWERVE_S) if self.active else PAUSE_S
            self._left = round(self._rng.uniform(*lasts) / TICK_S)
            self._noise = self._rng.uniform(-1.0, 1.0, 2) * (ACCELERATION, min(STEERING, TURN_M_S / max(speed, 1.0)))
            self._brakes = self._rng.uniform(*STALL)
        self._left -= 1
        if not self.active:
            return action
        if self._stalls:
            return np.array([min(action[0], self._brakes), action[1]])
        obeys = action[0] < -1.0  # lights that are obeyed must be recorded
        noisy = action + self._noise * (not obeys, 1.0)
        return np.asarray(np.clip(noisy, AccelerationSteering.space.low, AccelerationSteering.space.high))
