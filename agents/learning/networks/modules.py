"""Networks of off-policy learners: an encoder of named observations, and heads on its features."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import pairwise

import torch
from gymnasium.spaces import Box, Dict
from torch import Tensor, nn
from torchrl.modules import NoisyLinear

from dohyo.sumo_networks.errors import InvalidInputError

LOG_STD = (-20.0, 2.0)
"""Bounds of a Gaussian's logarithmic deviation, as in Haarnoja's implementation."""
COSINES = 64
"""Numbers that a quantile level is embedded in (Dabney et al. 2018)."""


class ObservationEncoder(nn.Module):
    """Vectors as they are and pictures encoded, joined in the order of their space.

    Attributes:
        features: Numbers in the result, F.
    """

    def __init__(self, space: Dict, encoders: Mapping[str, nn.Module] | None = None) -> None:
        """Checks the space.

        Args:
            space: Of one observation.
            encoders: One for each picture, by name, with the attribute `features`.

        Raises:
            InvalidInputError: A picture has no encoder.
        """
        super().__init__()
        self.encoders = nn.ModuleDict(encoders or {})
        self._names = tuple(space.spaces)
        self.features = 0
        for name, box in space.items():
            if name in self.encoders:
                self.features += int(self.encoders[name].features)  # type: ignore[arg-type]
            elif isinstance(box, Box) and len(box.shape) == 1:
                self.features += box.shape[0]
            else:
                raise InvalidInputError(f"expected an encoder for observation '{name}', which is no vector: {box}")

    def forward(self, observation: Mapping[str, Tensor]) -> Tensor:
        """(B, ...) by name -> (B, F)."""
        parts = [
            self.encoders[name](observation[name]) if name in self.encoders else observation[name]
            for name in self._names
        ]
        return parts[0] if len(parts) == 1 else torch.cat(parts, dim=-1)


def mlp(sizes: Sequence[int]) -> nn.Sequential:
    """Linear layers with ReLU between them."""
    layers: list[nn.Module] = []
    for before, after in pairwise(sizes):
        layers += [nn.Linear(before, after), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


class BatchedLinear(nn.Module):
    """E linear layers in one product: (B, I) or (E, B, I) -> (E, B, O), each initialised as torch's `Linear`."""

    def __init__(self, count: int, inputs: int, outputs: int) -> None:
        super().__init__()
        bound = 1.0 / math.sqrt(inputs)
        self.weight = nn.Parameter(torch.empty(count, inputs, outputs).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.empty(count, 1, outputs).uniform_(-bound, bound))

    def forward(self, rows: Tensor) -> Tensor:
        """See the class."""
        return torch.baddbmm(self.bias, rows.expand(len(self.weight), *rows.shape[-2:]), self.weight)


class Critics(nn.Module):
    """E critics as one batched module: features and action -> values."""

    def __init__(self, features: int, actions: int, hidden: Sequence[int], count: int) -> None:
        """Draws weights from torch's generator.

        Args:
            features: F.
            actions: A.
            hidden: Width of each hidden layer.
            count: E.
        """
        super().__init__()
        layers: list[nn.Module] = []
        for before, after in pairwise((features + actions, *hidden, 1)):
            layers += [BatchedLinear(count, before, after), nn.ReLU()]
        self.body = nn.Sequential(*layers[:-1])

    def forward(self, features: Tensor, action: Tensor) -> Tensor:
        """(B, F) and (B, A) -> (E, B)."""
        values: Tensor = self.body(torch.cat([features, action], dim=-1))
        return values.squeeze(-1)


class GaussianHead(nn.Module):
    """Features -> mean and logarithmic deviation of a Gaussian that depends on them; see `distributions`."""

    def __init__(self, features: int, actions: int, hidden: Sequence[int]) -> None:
        """Draws weights from torch's generator.

        Args:
            features: F.
            actions: A.
            hidden: Width of each hidden layer.
        """
        super().__init__()
        self.body = mlp((features, *hidden, 2 * actions))

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """(B, F) -> (B, A) mean, (B, A) logarithm of the standard deviation."""
        mean, log_std = self.body(features).chunk(2, dim=-1)
        return mean, log_std.clamp(*LOG_STD)

    def centre(self, features: Tensor) -> Tensor:
        """(B, F) -> (B, A) the action without exploration, in [-1, 1]."""
        mean, _ = self(features)
        action: Tensor = mean.tanh()
        return action


class DeterministicHead(nn.Module):
    """Features -> action in [-1, 1]^A."""

    def __init__(self, features: int, actions: int, hidden: Sequence[int]) -> None:
        """Draws weights from torch's generator.

        Args:
            features: F.
            actions: A.
            hidden: Width of each hidden layer.
        """
        super().__init__()
        self.body = mlp((features, *hidden, actions))

    def forward(self, features: Tensor) -> Tensor:
        """(B, F) -> (B, A)."""
        return torch.tanh(self.body(features))


class DuelingHead(nn.Module):
    """Features -> values of actions, as a state's value and advantages whose mean is 0 (Wang et al. 2016)."""

    def __init__(self, features: int, actions: int, linear: Callable[[int, int], nn.Module]) -> None:
        """Draws weights from torch's generator.

        Args:
            features: F.
            actions: A.
            linear: Makes a layer.
        """
        super().__init__()
        self.value, self.advantage = linear(features, 1), linear(features, actions)

    def forward(self, features: Tensor) -> Tensor:
        """(..., F) -> (..., A)."""
        advantage: Tensor = self.advantage(features)
        values: Tensor = self.value(features) + advantage - advantage.mean(dim=-1, keepdim=True)
        return values


class QuantileNetwork(nn.Module):
    """Implicit quantile network (Dabney et al. 2018): features and levels -> quantiles of every action's return.

    All hidden layers come before the product with the levels' embedding, and so run once per state; Dabney's last one
    comes behind it.
    """

    frequencies: Tensor

    def __init__(
        self, features: int, actions: int, hidden: Sequence[int], *, dueling: bool = False, noise: float = 0.0
    ) -> None:
        """Draws weights from torch's generator.

        Args:
            features: F.
            actions: Number of choices, A.
            hidden: Width of each hidden layer; the last one's is that of the levels' embedding.
            dueling: Whether the head is a `DuelingHead`.
            noise: Deviation of the head's weights at the start (Fortunato et al. 2018), in training; 0: none.
        """
        super().__init__()
        self.body = nn.Sequential(mlp((features, *hidden)), nn.ReLU())
        self.embedding = nn.Sequential(nn.Linear(COSINES, hidden[-1]), nn.ReLU())
        noisy = partial(NoisyLinear, std_init=noise, use_exploration_type=False)  # by `training`, as dropout
        linear: Callable[[int, int], nn.Module] = noisy if noise else nn.Linear
        self.head = DuelingHead(hidden[-1], actions, linear) if dueling else linear(hidden[-1], actions)
        self.register_buffer("frequencies", math.pi * torch.arange(COSINES))

    def forward(self, features: Tensor, levels: Tensor) -> Tensor:
        """(B, F) and (B, N) levels in [0, 1], or (1, N) the same for all -> (B, N, A)."""
        quantiles: Tensor = self.head(self.body(features)[:, None] * self._embedded(levels))
        return quantiles

    def mean(self, features: Tensor, levels: Tensor) -> Tensor:
        """(B, F) and (N,) levels -> (B, A) means over the levels.

        The head is linear behind the embedding, so that the embeddings' mean gives the quantiles' mean, in one product.
        """
        mean: Tensor = self.head(self.body(features) * self._embedded(levels).mean(dim=0))
        return mean

    def renew_noise(self) -> None:
        """Draws the noise of the weights anew, from torch's generator."""
        for layer in self.head.modules():
            if isinstance(layer, NoisyLinear):
                layer.reset_noise()

    def _embedded(self, levels: Tensor) -> Tensor:
        """(..., N) -> (..., N, last hidden width)."""
        embedded: Tensor = self.embedding(torch.cos(levels[..., None] * self.frequencies))
        return embedded


@contextmanager
def frozen(module: nn.Module) -> Iterator[None]:
    """What is computed inside has no gradient for the module's parameters, but one for its inputs."""
    parameters = list(module.parameters())
    for parameter in parameters:
        parameter.requires_grad_(False)
    try:
        yield
    finally:
        for parameter in parameters:
            parameter.requires_grad_(True)


@contextmanager
def evaluating(module: nn.Module) -> Iterator[None]:
    """The module is in evaluation inside: no dropout, no local mixing, stored moments of batch normalisations."""
    training = module.training
    module.eval()
    try:
        yield
    finally:
        module.train(training)


@torch.no_grad()
def soft_update(target: nn.Module, online: nn.Module, rate: float) -> None:
    """Moves the target's parameters towards those of the online network: by a rate, at 1 to them."""
    torch._foreach_lerp_(list(target.parameters()), list(online.parameters()), rate)
