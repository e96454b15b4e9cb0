"""Environments as other libraries make them. Without torch, since the processes of environments import this."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, Space, Text, Tuple


class Drawn(gymnasium.Env[Any, Any]):
    """Draws observations from any space, and keeps the actions it was given."""

    def __init__(self, observations: Space[Any], actions: Space[Any]) -> None:
        self.observation_space, self.action_space = observations, actions
        self.actions: list[Any] = []

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        self.observation_space.seed(seed)
        self.actions = []
        return self.observation_space.sample(), {}

    def step(self, action: Any) -> Any:
        assert self.action_space.contains(action)
        self.actions.append(action)
        return self.observation_space.sample(), 0.0, len(self.actions) == 7, False, {}


CABINET = Dict(
    {
        "goal": Box(-1.0, 1.0, (3,), np.float64),
        "nested": Dict({"grid": Box(-1.0, 1.0, (2, 2), np.float32), "flags": MultiBinary(3)}),
        "choice": Discrete(4, start=2),
        "pair": Tuple((Discrete(2), Box(0, 9, (1,), np.int64))),
    }
)

gymnasium.register("Cabinet-v0", entry_point=lambda: Drawn(CABINET, Box(-2.0, 0.1, (2, 1), np.float64)))
gymnasium.register("Written-v0", entry_point=lambda: Drawn(Text(5), Discrete(2)))
