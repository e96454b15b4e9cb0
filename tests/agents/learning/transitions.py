"""A known world: a point in the plane that an action in [-2, 2]^2 pushes by half of it."""

from __future__ import annotations

import numpy as np
import torch
from gymnasium.spaces import Box, Dict, Discrete
from tensordict import TensorDict
from torch import Tensor

OBSERVATIONS = Dict({"observation": Box(-np.inf, np.inf, (2,), np.float32)})
ACTIONS = Box(-2.0, 2.0, (2,), np.float32)
MOVES = Discrete(4)
CPU = torch.device("cpu")
_MOVES = torch.tensor([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])


def transitions(places: Tensor, actions: Tensor) -> TensorDict:
    """(B,) transitions from (B, 2) places by (B, 2) pushes, or (B,) numbers of moves."""
    pushed = _MOVES[actions] if actions.dtype == torch.int64 else actions
    rows = {"observation": {"observation": places}, "action": actions}
    after = {"observation": {"observation": places + 0.5 * pushed}, "reward": torch.zeros(len(places), 1)}
    return TensorDict({**rows, "next": after}, [len(places)])


def experience(count: int, seed: int = 0) -> TensorDict:
    """Random pushes at random places in [-1, 1]^2."""
    generator = torch.Generator().manual_seed(seed)
    places = torch.rand(count, 2, generator=generator) * 2 - 1
    return transitions(places, torch.rand(count, 2, generator=generator) * 4 - 2)


def homeward(count: int, seed: int = 1) -> TensorDict:
    """Pushes of an expert that returns to the origin at once."""
    places = torch.rand(count, 2, generator=torch.Generator().manual_seed(seed)) * 2 - 1
    return transitions(places, -2.0 * places)
