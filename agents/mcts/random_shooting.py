"""Random shooting: MBAPPE without its tree. The same actions, constraints, prior and reward, sampled independently."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np

from dohyo.agents.mcts.config import Settings
from dohyo.agents.mcts.mbappe import Mbappe
from dohyo.evaluation.agent import AgentSpec, Mission
from dohyo.evaluation.settings import FieldsOf
from dohyo.sumo_networks.arrays import FloatArray


class RandomShooting(Mbappe):
    """Draws as many rollouts from the prior as MBAPPE simulates, and executes the best one.

    Its settings are MBAPPE's; the final choice is always the best rollout.
    """

    spec = AgentSpec(name="random-shooting", **Mbappe.spec.model_dump(exclude={"name"}))

    def __init__(self, choice: Literal["best"] = "best", **settings: Annotated[Any, FieldsOf(Settings)]) -> None:
        self._rng = np.random.default_rng(0)
        super().__init__(choice=choice, **settings)

    def reset(self, mission: Mission, seed: int) -> None:
        """Seeds the random generator."""
        super().reset(mission, seed)
        self._rng = np.random.default_rng(seed)

    def _draws(self) -> FloatArray:
        return self._rng.random(self.settings.simulations * self.rules.depth)
