"""Reckless: follows its lane and ignores all traffic. A check of the benchmark: it must fail."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from dohyo.evaluation.agent import Agent, AgentSpec, Mission, Observation
from dohyo.sumo_networks.ego.control import pure_pursuit
from dohyo.sumo_networks.ego.dynamics import VehicleParameters

AIM_M = 6


class Reckless(Agent):
    """Constant throttle, steering along the route."""

    spec = AgentSpec(name="reckless", track="map", sensors=("route",), control="pedals_steering")

    def __init__(self, throttle: Annotated[float, Field(ge=0, le=1)] = 0.5) -> None:
        self.throttle = throttle
        self._vehicle = VehicleParameters()

    def reset(self, mission: Mission, seed: int) -> None:
        """Nothing to prepare."""

    def act(self, observation: Observation) -> np.ndarray:
        """Throttle, no brake, pure pursuit of a point 6 m ahead."""
        x, y = observation["route"][AIM_M, :2]
        steering = pure_pursuit(self._vehicle, float(x), float(y)) / self._vehicle.max_steering
        return np.array([self.throttle, 0.0, steering])
