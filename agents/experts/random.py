"""Random: the lower bound of every table."""

from __future__ import annotations

import numpy as np

from dohyo.evaluation.agent import Agent, AgentSpec, Mission, Observation
from dohyo.sumo_networks.ego.control import PedalsSteering


class Random(Agent):
    """Uniform pedals and steering, held for a second."""

    spec = AgentSpec(name="random", track="sensors", sensors=("speedometer",), control="pedals_steering")

    def reset(self, mission: Mission, seed: int) -> None:
        """Seeds the random generator."""
        self._rng = np.random.default_rng(seed)
        self._ticks = 0
        self._action = np.zeros(3)

    def act(self, observation: Observation) -> np.ndarray:
        """A new draw every tenth tick."""
        if self._ticks % 10 == 0:
            self._action = self._rng.uniform(PedalsSteering.space.low, PedalsSteering.space.high)
        self._ticks += 1
        return self._action
