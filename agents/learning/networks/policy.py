"""Policies of PPO: actors on a vector of features, and what makes that vector of named observations."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from gymnasium.spaces import Box, Discrete
from safetensors import SafetensorError, safe_open
from tensordict.nn import NormalParamExtractor
from torch import Tensor, nn
from torchrl.modules import IndependentNormal, TanhNormal

from dohyo.agents.learning.tasks.task import Array
from dohyo.sumo_networks.errors import InvalidInputError

Named = Mapping[str, Tensor]

SIZES = "sizes"
FARTHEST = 10.0
"""Bound of normalised observations, in standard deviations."""


class PpoActor(Protocol):
    """Policy of PPO on a vector of features (..., O); its variable is what its density is of.

    Attributes:
        parameter_names: Of the distribution's parameters, in the order of `parameters_at`.
        distribution: Class of the distribution.
        sizes: Features, width of each hidden layer, outputs.
    """

    parameter_names: tuple[str, ...]
    distribution: Any
    sizes: tuple[int, ...]

    def __call__(self, features: Tensor) -> Tensor:
        """(..., O) -> the action without exploration, in the action space."""

    def parameters(self) -> Iterator[nn.Parameter]:
        """Weights, as of any torch module."""

    def parameters_at(self, features: Tensor) -> tuple[Tensor, ...]:
        """(..., O) -> the distribution's parameters."""

    def sample(self, features: Tensor) -> Tensor:
        """(..., O) -> a value of the variable, drawn from torch's generator."""

    def action_of(self, variable: Tensor) -> Tensor:
        """Action, in the action space, of a value of the variable."""

    def variable_of(self, action: Tensor) -> Tensor:
        """Value of the variable of an action in the action space."""


class Actor(nn.Module):
    """Gaussian whose deviation does not depend on the observation: features -> [-1, 1]^A, scaled to the action space.

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
    parameter_names: tuple[str, ...] = ("loc", "scale")
    distribution: Any = IndependentNormal

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

    def forward(self, observation: Tensor | Named) -> Tensor:
        """(..., O), or such vectors by name -> (..., A) the mean action, in the action space."""
        return self.scaled(self.body(normalised(joined(observation), self.shift, self.scale)))

    def parameters_at(self, features: Tensor) -> tuple[Tensor, ...]:
        """See `PpoActor`."""
        return self.gaussian(features)

    def sample(self, features: Tensor) -> Tensor:
        """See `PpoActor`."""
        return torch.normal(*self.gaussian(features))

    def action_of(self, variable: Tensor) -> Tensor:
        """See `PpoActor`."""
        return self.scaled(variable)

    def variable_of(self, action: Tensor) -> Tensor:
        """See `PpoActor`."""
        return self.unscaled(action)

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
        sizes, weights = _stored(path)
        try:
            actor = cls(sizes[0], weights["low"], weights["high"], sizes[1:-1])
            actor.load_state_dict(weights)
        except (KeyError, IndexError, RuntimeError) as error:
            raise InvalidInputError(f"'{path}' is no actor: {str(error).splitlines()[0]}") from error
        return actor.eval()

    def facts(self) -> Mapping[str, str]:
        """Arguments that `load` needs beside the weights."""
        return {SIZES: json.dumps(self.sizes)}


class TanhActor(nn.Module):
    """Gaussian whose deviation depends on the observation, squashed by tanh to actions in [-1, 1]^A.

    Attributes:
        body: Network of the mean and of the deviation before its softplus.
    """

    parameter_names: tuple[str, ...] = ("loc", "scale")
    distribution: Any = TanhNormal
    LEAST_STD = 0.02

    def __init__(self, features: int, actions: int, hidden: Sequence[int], std: float = 0.5) -> None:
        """Draws weights from torch's generator.

        Args:
            features: Numbers in one observation, O.
            actions: Numbers in one action, A.
            hidden: Width of each hidden layer.
            std: Standard deviation at the start, before tanh.
        """
        super().__init__()
        self.sizes, self.actions = (features, *hidden, actions), actions
        self.body = layers((features, *hidden, 2 * actions), last_gain=0.1)
        self._extract = NormalParamExtractor(scale_mapping="softplus", scale_lb=self.LEAST_STD)
        last = self.body[-1]
        assert isinstance(last, nn.Linear)
        with torch.no_grad():
            last.bias[actions:] = math.log(math.expm1(std))

    def forward(self, observation: Tensor | Named) -> Tensor:
        """(..., O), or such vectors by name -> (..., A) in [-1, 1]."""
        return torch.tanh(self.body(joined(observation))[..., : self.actions])

    def parameters_at(self, features: Tensor) -> tuple[Tensor, ...]:
        """See `PpoActor`."""
        loc, scale = self._extract(self.body(features))
        return loc, scale

    def sample(self, features: Tensor) -> Tensor:
        """See `PpoActor`."""
        return torch.tanh(torch.normal(*self.parameters_at(features)))

    def action_of(self, variable: Tensor) -> Tensor:
        """See `PpoActor`."""
        return variable

    def variable_of(self, action: Tensor) -> Tensor:
        """See `PpoActor`."""
        return action

    def act(self, observation: Array) -> Array:
        """(..., O) -> (..., A) as arrays."""
        with torch.no_grad():
            return np.asarray(self(torch.as_tensor(observation, dtype=torch.float32)).numpy())

    @classmethod
    def load(cls, path: Path) -> TanhActor:
        """Reads an actor from safetensors, onto the CPU.

        Raises:
            InvalidInputError: The file is missing, or holds no such actor.
        """
        sizes, weights = _stored(path)
        try:
            actor = cls(sizes[0], sizes[-1], sizes[1:-1])
            actor.load_state_dict(weights)
        except (KeyError, IndexError, RuntimeError) as error:
            raise InvalidInputError(f"'{path}' is no actor: {str(error).splitlines()[0]}") from error
        return actor.eval()

    def facts(self) -> Mapping[str, str]:
        """Arguments that `load` needs beside the weights."""
        return {SIZES: json.dumps(self.sizes)}


class CategoricalActor(nn.Module):
    """One of a number of choices.

    Attributes:
        body: Network of the logits.
    """

    parameter_names: tuple[str, ...] = ("logits",)
    distribution: Any = torch.distributions.Categorical

    def __init__(self, features: int, choices: int, hidden: Sequence[int]) -> None:
        """Draws weights from torch's generator.

        Args:
            features: Numbers in one observation, O.
            choices: Number of actions.
            hidden: Width of each hidden layer.
        """
        super().__init__()
        self.sizes = (features, *hidden, choices)
        self.body = layers(self.sizes, last_gain=0.01)

    def forward(self, observation: Tensor | Named) -> Tensor:
        """(..., O), or such vectors by name -> (...) int64, the most probable action."""
        best: Tensor = self.body(joined(observation)).argmax(dim=-1)
        return best

    def parameters_at(self, features: Tensor) -> tuple[Tensor, ...]:
        """See `PpoActor`."""
        return (self.body(features),)

    def sample(self, features: Tensor) -> Tensor:
        """See `PpoActor`."""
        drawn: Tensor = self.distribution(logits=self.body(features)).sample()
        return drawn

    def action_of(self, variable: Tensor) -> Tensor:
        """See `PpoActor`."""
        return variable

    def variable_of(self, action: Tensor) -> Tensor:
        """See `PpoActor`."""
        return action

    def facts(self) -> Mapping[str, str]:
        """Arguments of the constructor."""
        return {SIZES: json.dumps(self.sizes)}


class EncodedPolicy(nn.Module):
    """An encoder of named observations, and the actor on its features."""

    def __init__(self, encoder: nn.Module, actor: PpoActor) -> None:
        super().__init__()
        self.encoder, self.actor = encoder, actor

    def forward(self, observation: Named) -> Tensor:
        """Named observations -> actions without exploration, in the action space."""
        action: Tensor = self.actor(self.encoder(observation))
        return action

    def facts(self) -> Mapping[str, str]:
        """Arguments of the actor's constructor."""
        return self.actor.facts()  # type: ignore[attr-defined, no-any-return]


def joined(observation: Tensor | Named) -> Tensor:
    """Named vectors, joined in their order; a tensor as it is."""
    if isinstance(observation, Tensor):
        return observation
    vectors: list[Tensor] = list(observation.values())
    return vectors[0] if len(vectors) == 1 else torch.cat(vectors, dim=-1)


def distribution_at(actor: PpoActor, features: Tensor) -> Any:
    """Distribution of an actor's variable, from (..., O) features."""
    parameters = dict(zip(actor.parameter_names, actor.parameters_at(features), strict=True))
    return actor.distribution(**parameters)


def actor_for(features: int, actions: Box | Discrete, hidden: Sequence[int], std: float, squashed: bool) -> PpoActor:
    """An untrained actor for an action space.

    Args:
        features: Numbers that it sees.
        actions: Checked by `task.check_spaces`.
        hidden: Width of each hidden layer.
        std: Standard deviation at the start, where the action space is [-1, 1].
        squashed: For vectors: by tanh (`TanhActor`), or clipped (`Actor`).

    Raises:
        InvalidInputError: A squashed actor for other bounds than [-1, 1].
    """
    if isinstance(actions, Discrete):
        return CategoricalActor(features, int(actions.n), hidden)
    if not squashed:
        return Actor(features, torch.as_tensor(actions.low), torch.as_tensor(actions.high), hidden, std)
    if not ((actions.low == -1.0).all() and (actions.high == 1.0).all()):
        raise InvalidInputError(f"expected actions in [-1, 1] for a squashed policy, got {actions}")
    return TanhActor(features, actions.shape[0], hidden, std)


def _stored(path: Path) -> tuple[list[int], dict[str, Tensor]]:
    """Sizes and weights of a stored actor.

    Raises:
        InvalidInputError: The file is missing, or holds no actor.
    """
    try:
        with safe_open(path, framework="pt") as file:
            sizes = json.loads((file.metadata() or {})[SIZES])
            return sizes, {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - no mapping
    except FileNotFoundError as error:
        raise InvalidInputError(f"no actor '{path}'") from error
    except (OSError, SafetensorError, KeyError, TypeError, ValueError) as error:
        raise InvalidInputError(f"'{path}' is no actor: {str(error).splitlines()[0]}") from error


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
