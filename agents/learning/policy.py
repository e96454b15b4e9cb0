"""Policies of continuous actions: a Gaussian actor, whose mean is shipped."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from gymnasium.spaces import Box
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn

from dohyo.agents.learning.task import Array
from dohyo.sumo_networks.errors import InvalidInputError

SIZES = "sizes"
FARTHEST = 10.0
"""Bound of normalised observations, in standard deviations."""


class Actor(nn.Module):
    """Observation -> action in [-1, 1]^A, scaled to the action space.

    Attributes:
        body: Network of the Gaussian's mean, in [-1, 1]^A and beyond.
        log_std: (A,) logarithm of the standard deviation, independent of the observation.
        low: (A,) lower bound of the action space.
        high: (A,) upper bound of the action space.
        shift: (O,) subtracted from an observation before it is divided by `scale`.
        scale: (O,) divisor of observations.
    """

    low: Tensor
    high: Tensor
    shift: Tensor
    scale: Tensor

    def __init__(self, observations: int, low: Tensor, high: Tensor, hidden: Sequence[int], std: float = 1.0) -> None:
        """Draws weights from torch's generator.

        Args:
            observations: Numbers in one observation, O.
            low: (A,).
            high: (A,).
            hidden: Width of each hidden layer.
            std: Standard deviation at the start, in [-1, 1]^A.
        """
        super().__init__()
        self.sizes = (observations, *hidden, len(low))
        self.body = layers(self.sizes, last_gain=0.01)
        self.log_std = nn.Parameter(torch.full((len(low),), math.log(std)))
        self.register_buffer("low", low.float())
        self.register_buffer("high", high.float())
        self.register_buffer("shift", torch.zeros(observations))
        self.register_buffer("scale", torch.ones(observations))

    def forward(self, observation: Tensor) -> Tensor:
        """(..., O) -> (..., A) the mean action, in the action space."""
        return self.scaled(self.body(normalised(observation, self.shift, self.scale)))

    def gaussian(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """(..., O) -> mean and standard deviation (..., A), in [-1, 1]^A and beyond."""
        mean = self.body(normalised(observation, self.shift, self.scale))
        return mean, self.log_std.exp().expand_as(mean)

    def normalise(self, shift: Tensor, scale: Tensor) -> None:
        """Sets the normalisation: (O,) shift and (O,) scale."""
        self.shift.copy_(shift)
        self.scale.copy_(scale)

    def scaled(self, unit: Tensor) -> Tensor:
        """(..., A) from [-1, 1]^A to the action space, clipped."""
        return self.low + (unit.clamp(-1.0, 1.0) + 1.0) / 2.0 * (self.high - self.low)

    def unscaled(self, action: Tensor) -> Tensor:
        """(..., A) from the action space to [-1, 1]^A, clipped."""
        return ((action - self.low) / (self.high - self.low) * 2.0 - 1.0).clamp(-1.0, 1.0)

    def act(self, observation: Array) -> Array:
        """One observation (O,) -> (A,) the mean action, in the action space."""
        with torch.no_grad():
            batch = torch.as_tensor(observation, dtype=torch.float32, device=self.low.device)[None]
            return np.asarray(self(batch)[0].cpu().numpy())

    @classmethod
    def load(cls, path: Path) -> Actor:
        """Reads an actor from safetensors, onto the CPU.

        Raises:
            InvalidInputError: The file is missing, or holds no actor.
        """
        try:
            with safe_open(path, framework="pt") as file:
                sizes = json.loads((file.metadata() or {})[SIZES])
                weights = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - no mapping
            actor = cls(sizes[0], weights["low"], weights["high"], sizes[1:-1])
            actor.load_state_dict(weights)
        except FileNotFoundError as error:
            raise InvalidInputError(f"no actor '{path}'") from error
        except (OSError, SafetensorError, KeyError, TypeError, ValueError, RuntimeError) as error:
            raise InvalidInputError(f"'{path}' is no actor: {str(error).splitlines()[0]}") from error
        return actor.eval()

    def facts(self) -> Mapping[str, str]:
        """Arguments that `load` needs beside the weights."""
        return {SIZES: json.dumps(self.sizes)}


def actor_for(observations: Box, actions: Box, hidden: Sequence[int], std: float) -> Actor:
    """An untrained actor for two spaces.

    Raises:
        InvalidInputError: One of them is not a vector of floats.
    """
    for what, space in (("observations", observations), ("actions", actions)):
        if len(space.shape) != 1 or space.dtype != np.float32:
            raise InvalidInputError(f"expected {what} to be vectors of float32, got {space.dtype} {space.shape}")
    low, high = torch.as_tensor(actions.low), torch.as_tensor(actions.high)
    return Actor(observations.shape[0], low, high, hidden, std)


def normalised(observation: Tensor, shift: Tensor, scale: Tensor) -> Tensor:
    """(..., O) normalised and bounded observations."""
    return ((observation - shift) / scale).clamp(-FARTHEST, FARTHEST)


def layers(sizes: Sequence[int], last_gain: float) -> nn.Sequential:
    """Linear layers with tanh between them, orthogonal at the start."""
    parts: list[nn.Module] = []
    for before, after in pairwise(sizes):
        linear = nn.Linear(before, after)
        nn.init.orthogonal_(linear.weight, math.sqrt(2.0))
        nn.init.zeros_(linear.bias)
        parts += [linear, nn.Tanh()]
    last = parts[-2]
    assert isinstance(last, nn.Linear)
    nn.init.orthogonal_(last.weight, last_gain)
    return nn.Sequential(*parts[:-1])
