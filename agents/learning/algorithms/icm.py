"""ICM: intrinsic curiosity module (Pathak et al. 2017), as a reward for a policy-gradient learner.

An inverse model predicts the action from the features of an observation and the next one: it shapes the features phi,
which so keep what the agent can influence. A forward model predicts phi(o') from phi(o) and the action. Its error is
the reward: r = eta / 2 * |phi_hat(o') - phi(o')|^2. The loss is (1 - beta) * inverse + beta * forward.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import Annotated, Any

import gymnasium
import torch
from gymnasium import spaces
from pydantic import Field
from tensordict import TensorDictBase
from torch import Tensor, nn
from torch.nn.functional import cross_entropy, mse_loss
from torchrl.modules import MLP

from dohyo.agents.learning.files.metrics import Number
from dohyo.agents.learning.networks.modules import ObservationEncoder
from dohyo.agents.learning.networks.vectors import ActionVector
from dohyo.agents.learning.runs.config import Positive
from dohyo.sumo_networks.config import Config


class IcmConfig(Config):
    """Settings of the models and their reward. Defaults: Unity ML-Agents, where not marked otherwise.

    Attributes:
        eta: Factor of the reward (Pathak: 0.01; the thesis has no number).
        beta: Weight of the forward model's loss, beside that of the inverse model (Pathak).
        features: Numbers in phi.
        hidden: Width of each hidden layer of the encoder and of both models.
        learning_rate: Of Adam.
        batch: Transitions in a gradient step.
        epochs: Passes over the transitions of a round.
    """

    eta: Annotated[float, Field(gt=0)] = 0.01
    beta: Annotated[float, Field(gt=0, lt=1)] = 0.2
    features: Positive = 64
    hidden: Annotated[tuple[Positive, ...], Field(min_length=1)] = (128,)
    learning_rate: Annotated[float, Field(gt=0)] = 3e-4
    batch: Positive = 128
    epochs: Positive = 3


class Icm(nn.Module):
    """Forward and inverse model of an environment; an `IntrinsicReward`."""

    columns: tuple[str, ...] = ("icm_reward", "icm_inverse", "icm_forward")

    def __init__(
        self,
        observations: spaces.Dict,
        actions: gymnasium.Space[Any],
        config: IcmConfig,
        device: torch.device,
        encoder: nn.Module | None = None,
    ) -> None:
        """Draws weights from torch's generator.

        Args:
            observations: Space of one observation.
            actions: Space of one action.
            config: Settings.
            device: Of the models.
            encoder: phi, from a batch of observations to (B, features); None: of vectors, concatenated.

        Raises:
            InvalidInputError: The observations hold pictures, and there is no encoder.
        """
        super().__init__()
        self._config, self._device = config, device
        self._action = ActionVector(actions)
        if encoder is None:
            vector = ObservationEncoder(observations)
            encoder = nn.Sequential(vector, MLP(vector.features, config.features, num_cells=config.hidden))
        self._phi = encoder
        self._inverse = MLP(2 * config.features, self._action.size, num_cells=config.hidden)
        self._forward = MLP(config.features + self._action.size, config.features, num_cells=config.hidden)
        self.to(device)
        self._optimizer = torch.optim.Adam(self.parameters(), lr=config.learning_rate)

    def losses(self, transitions: TensorDictBase) -> tuple[Tensor, Tensor]:
        """Losses of (B,) transitions, without reduction.

        Returns:
            (B,) of the inverse model: the squared error in [-1, 1]^A, or the cross-entropy of a Discrete action. And
            (B,) of the forward model: half the squared distance of the features.
        """
        before = self._phi(transitions["observation"].to(self._device))
        after = self._phi(transitions["next", "observation"].to(self._device))
        action = self._action(transitions["action"].to(self._device))
        told = self._inverse(before, after)
        if self._action.discrete:
            inverse = cross_entropy(told, action, reduction="none")
        else:
            inverse = mse_loss(told, action, reduction="none").sum(dim=-1)
        expected = self._forward(before, action)
        return inverse, 0.5 * (expected - after).square().sum(dim=-1)

    @torch.no_grad()
    def reward(self, transitions: TensorDictBase) -> Tensor:
        """(B, 1) eta times the forward model's loss."""
        _, error = self.losses(transitions)
        return self._config.eta * error[:, None].to(transitions.device or "cpu")

    def update(self, transitions: TensorDictBase) -> Mapping[str, Number]:
        """Gradient steps of both models and the features.

        Returns:
            Mean of each loss.
        """
        sums, count = defaultdict[str, float](float), 0
        for _ in range(self._config.epochs):
            for rows in torch.split(torch.randperm(len(transitions)), self._config.batch):
                inverse, forward = (loss.mean() for loss in self.losses(transitions[rows]))
                self._optimizer.zero_grad(set_to_none=True)
                ((1.0 - self._config.beta) * inverse + self._config.beta * forward).backward()  # type: ignore[no-untyped-call]
                self._optimizer.step()
                count += 1
                sums["icm_inverse"] += inverse.item()
                sums["icm_forward"] += forward.item()
        return {name: value / count for name, value in sums.items()}

    def state(self) -> dict[str, Any]:
        """State for a checkpoint."""
        return {"models": self.state_dict(), "optimizer": self._optimizer.state_dict()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state."""
        self.load_state_dict(state["models"])
        self._optimizer.load_state_dict(state["optimizer"])
