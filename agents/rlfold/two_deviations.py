"""Two standard deviations on one mean: a policy that explores by the first, and imitates an expert by the second.

The action is tanh(mean + sigma_RL noise), as in SAC. An expert's action is judged by a Gaussian around tanh(mean) with
sigma_IL, truncated to [-1, 1], so that a policy can be unsure of the expert and sure of itself.

Source: Coelho 2024, section 4.2, and the author's release for the bounds of sigma_IL. The release judges by the density
of a plain Gaussian; ours is the truncated one's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from dohyo.agents.learning.networks.modules import GaussianHead, mlp

LEAST_STD, STD_RANGE = 0.1, 2.0
"""sigma_IL is 0.1 + 2 sigmoid(x / 2)."""
LOG_STD = (-10.0, 2.0)
"""Bounds of the logarithm of sigma_RL (table 3.2)."""
_ROOT_2, _LOG_ROOT_TAU = math.sqrt(2.0), 0.5 * math.log(2.0 * math.pi)


class TwoDeviationsHead(GaussianHead):
    """Features -> mean, and the logarithm of sigma_RL; `imitating` gives tanh(mean) and sigma_IL.

    A bounded mean is itself in [-1, 1] before the squashing, as in the release: tanh(tanh(mean) + sigma_RL noise). An
    unbounded one is pushed far out by labels at a bound, where the squashing hides any deviation.
    """

    def __init__(self, features: int, actions: int, hidden: Sequence[int], bounded: bool = False) -> None:
        """See `GaussianHead`."""
        super().__init__(features, actions, hidden)
        self.body, self._bounded = mlp((features, *hidden, 3 * actions)), bounded

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """(B, F) -> (B, A) mean, (B, A) logarithm of sigma_RL."""
        mean, log_std, _ = self.body(features).chunk(3, dim=-1)
        return mean.tanh() if self._bounded else mean, log_std.clamp(*LOG_STD)

    def centre(self, features: Tensor) -> Tensor:
        """See `GaussianHead`; a bounded mean is not squashed twice."""
        return self.imitating(features)[0]

    def imitating(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """(B, F) -> (B, A) tanh(mean), (B, A) sigma_IL."""
        mean, _, raw = self.body(features).chunk(3, dim=-1)
        return mean.tanh(), LEAST_STD + STD_RANGE * torch.sigmoid(raw / 2.0)


def truncated_log_density(value: Tensor, mean: Tensor, std: Tensor) -> Tensor:
    """Logarithm of the density of a Gaussian truncated to [-1, 1], elementwise; `mean` is in [-1, 1]."""
    inside = _below((1.0 - mean) / std) - _below((-1.0 - mean) / std)
    return -0.5 * ((value - mean) / std).square() - std.log() - _LOG_ROOT_TAU - inside.log()


def _below(value: Tensor) -> Tensor:
    """Share of a standard Gaussian below a value."""
    return 0.5 * (1.0 + torch.erf(value / _ROOT_2))
