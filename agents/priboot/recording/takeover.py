"""Takeovers: a learner drives for a while, and the demonstrator goes on from where that led.

A demonstrator alone never stands three metres behind a parked car, so that a learner which ends there never saw how to
go round it. Ours, after DAgger (Ross et al. 2011); of the learner's drives nothing is recorded but what comes after.
"""

from __future__ import annotations

import numpy as np

from dohyo.evaluation.agent import Agent, Observation
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.control import AccelerationSteering
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.scenario import Mission
from dohyo.sumo_networks.units import TICK_S

LEARNER_S, DEMONSTRATOR_S = (4.0, 16.0), (4.0, 9.0)
"""Shortest and longest time for which either drives."""


class Takeovers:
    """Learner and demonstrator in turn; the latter begins.

    Attributes:
        active: Whether the learner drove the last tick.
        stalls: Never.
        told_s: None.
    """

    stalls = False
    told_s: float | None = None

    def __init__(self, learner: Agent, mission: Mission, rng: np.random.Generator) -> None:
        """Starts with the demonstrator.

        Args:
            learner: Its actions are pedals and steering.
            mission: What it drives.
            rng: Of the times.
        """
        self._learner, self._mission, self._rng, self.active = learner, mission, rng, False
        self._left = round(rng.uniform(*DEMONSTRATOR_S) / TICK_S)

    def disturbed(self, action: FloatArray, speed: float, observation: Observation) -> FloatArray:
        """(2,) acceleration and steering of who drives this tick, given the demonstrator's."""
        if self._left == 0:
            self.active = not self.active
            self._left = round(self._rng.uniform(*(LEARNER_S if self.active else DEMONSTRATOR_S)) / TICK_S)
            self._learner.reset(self._mission, 0)
        self._left -= 1
        if not self.active:
            return action
        return accelerated(np.asarray(self._learner.act(observation)), speed)


def accelerated(pedals: FloatArray, speed: float) -> FloatArray:
    """(2,) acceleration [m/s^2] and steering of (3,) throttle, brake and steering at a speed [m/s] on a dry road."""
    vehicle, (throttle, brake, steering) = VehicleParameters(), pedals
    drive = throttle * vehicle.traction_limit(speed) - brake * vehicle.max_braking
    bounds = AccelerationSteering.space
    return np.asarray(np.clip([drive - vehicle.resistance(speed), steering], bounds.low, bounds.high))
