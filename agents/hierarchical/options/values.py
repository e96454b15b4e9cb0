"""Values of options: the networks Q_Omega and beta, and the choice by them; `training/option_losses.py` trains them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from dohyo.sumo_networks.arrays import BoolArray, Float32Array
from dohyo.sumo_networks.errors import InvalidInputError


class OptionValues(nn.Module):
    """Q_Omega(s, o) and beta(s, o) of every option, from one body each."""

    def __init__(self, size: int, options: int, hidden: Sequence[int]) -> None:
        """Makes the networks.

        Args:
            size: Numbers in a state.
            options: How many options.
            hidden: Width of each hidden layer.
        """
        super().__init__()
        self.values = _perceptron(size, hidden, options)
        self.endings = _perceptron(size, hidden, options)
        last = self.endings[-1]
        assert isinstance(last, nn.Linear)
        # An option lasts ten ticks at first, on average.
        nn.init.constant_(last.bias, -2.2)

    def forward(self, states: Tensor) -> tuple[Tensor, Tensor]:
        """Q and beta.

        Args:
            states: (N, size).

        Returns:
            (N, options) each; beta in (0, 1).
        """
        return self.values(states), torch.sigmoid(self.endings(states))


def choose(q: Float32Array, available: BoolArray, epsilon: float, rng: np.random.Generator) -> int:
    """Epsilon-greedy among the options that may begin.

    Raises:
        InvalidInputError: No option may begin.
    """
    open_ = np.flatnonzero(available)
    if not len(open_):
        raise InvalidInputError("expected at least one option that may begin, got none")
    if epsilon > 0.0 and rng.random() < epsilon:
        return int(rng.choice(open_))
    return int(open_[np.argmax(q[open_])])


def _perceptron(size: int, hidden: Sequence[int], outputs: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for before, after in zip([size, *hidden], hidden, strict=False):
        layers += [nn.Linear(before, after), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(([size, *hidden])[-1], outputs))
