"""Agents in one process that do what workers of worlds do."""

from __future__ import annotations

import numpy as np

from dohyo.evaluation.agent import Agent, AgentSpec, Mission, Observation


class Keeper(Agent):
    """What examples/world_worker.py does."""

    spec = AgentSpec(name="keeper", sensors=("speedometer",), control="lane_command")

    def __init__(self, speed_mps: float) -> None:
        self.speed_mps = speed_mps

    def reset(self, mission: Mission, seed: int) -> None:
        pass

    def act(self, observation: Observation) -> np.ndarray:
        return np.array([min(self.speed_mps, float(observation["speedometer"][0]) + 0.5), 0.0])

    def close(self) -> None:
        pass
