"""Actions as vectors, for models of transitions such as discriminators and inverse dynamics."""

from __future__ import annotations

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from torch import Tensor, nn

from dohyo.sumo_networks.errors import InvalidInputError


class ActionVector(nn.Module):
    """Actions of a Box as vectors in [-1, 1]^A, those of a Discrete space as one-hot vectors.

    Attributes:
        size: Numbers in a vector, A.
        discrete: Whether the actions are numbers from 0.
    """

    low: Tensor
    high: Tensor

    def __init__(self, space: gymnasium.Space[np.generic]) -> None:
        """Reads the bounds of the space.

        Args:
            space: Box with finite bounds, or Discrete.

        Raises:
            InvalidInputError: The space is of another kind.
        """
        super().__init__()
        self.discrete = isinstance(space, spaces.Discrete)
        if isinstance(space, spaces.Discrete):
            low, high = np.zeros(int(space.n)), np.ones(int(space.n))
        elif isinstance(space, spaces.Box) and space.is_bounded() and len(space.shape) == 1:
            low, high = space.low, space.high
        else:
            raise InvalidInputError(f"expected actions of a vector with finite bounds, or Discrete, got {space}")
        self.size = len(low)
        self.register_buffer("low", torch.as_tensor(low, dtype=torch.float32))
        self.register_buffer("high", torch.as_tensor(high, dtype=torch.float32))

    def forward(self, action: Tensor) -> Tensor:
        """(..., A) or (...,) actions of the space -> (..., A)."""
        if self.discrete:
            return nn.functional.one_hot(action.long(), self.size).float()
        return (action - self.low) / (self.high - self.low) * 2.0 - 1.0

    def inverse(self, vector: Tensor) -> Tensor:
        """(..., A) vectors, or logits of a Discrete space -> actions of the space, clipped to its bounds."""
        if self.discrete:
            return vector.argmax(dim=-1)
        return self.low + (vector.clamp(-1.0, 1.0) + 1.0) / 2.0 * (self.high - self.low)
