"""Implicit quantile network (Dabney et al. 2018): the distribution of every discrete action's return.

Rainbow-IQN (Toromanoff et al. 2019) is this with `double`, `dueling`, `noise`, and the replay's steps and priorities.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Annotated, Any

import torch
from gymnasium.spaces import Discrete
from pydantic import Field
from tensordict import TensorDictBase
from torch import Tensor, nn

from dohyo.agents.learning.algorithms.off_policy import OffPolicy, OffPolicyConfig, linear, weighted
from dohyo.agents.learning.networks.modules import QuantileNetwork, soft_update
from dohyo.agents.learning.runs.config import Positive, Share
from dohyo.agents.perception.encoders.local_mixing import parameter_groups


class IqnConfig(OffPolicyConfig):
    """Settings; K and kappa are Dabney's, whose N and N' are 64; the others are those of stable-baselines3's DQN.

    Attributes:
        learning_rate: Of Adam.
        gradient_norm: Upper bound.
        target_every: Gradient steps between two copies to the target network.
        quantiles: Levels per state in the loss, N.
        target_quantiles: Levels per next state in the loss, N'.
        greedy_quantiles: Levels whose mean decides an action, K.
        kappa: Where the Huber loss becomes linear.
        first_exploration: Probability of a random action at the start.
        last_exploration: The same from `exploration_steps` on.
        exploration_steps: Environment steps between the two, linearly.
        hidden: Width of each hidden layer.
        double: Whether the learned network chooses the action that the target network values (van Hasselt et al. 2016).
        dueling: Whether values are those of a state and advantages (Wang et al. 2016).
        noise: Deviation of the head's noisy weights at the start (Fortunato et al. 2018: 0.5); 0: none.
    """

    batch: Positive = 32
    updates_per_step: Annotated[float, Field(gt=0)] = 0.25
    learning_rate: Annotated[float, Field(gt=0)] = 1e-4
    gradient_norm: Annotated[float, Field(gt=0)] = 10.0
    target_every: Positive = 2500
    quantiles: Positive = 8
    target_quantiles: Positive = 8
    greedy_quantiles: Positive = 32
    kappa: Annotated[float, Field(gt=0)] = 1.0
    first_exploration: Share = 1.0
    last_exploration: Share = 0.05
    exploration_steps: Positive = 10_000
    hidden: Annotated[tuple[Positive, ...], Field(min_length=1)] = (64, 64)
    double: bool = False
    dueling: bool = False
    noise: Annotated[float, Field(ge=0)] = 0.0


class IqnPolicy(nn.Module):
    """Observations by name -> the action with the highest mean return, over K evenly spread levels."""

    levels: Tensor

    def __init__(self, encoder: nn.Module, network: QuantileNetwork, count: int) -> None:
        super().__init__()
        self.encoder, self.network = encoder, network
        self.register_buffer("levels", (torch.arange(count) + 0.5) / count)

    def forward(self, observation: Mapping[str, Tensor]) -> Tensor:
        """(B, ...) by name -> (B,)."""
        return self.greedy(self.encoder(observation))

    def greedy(self, features: Tensor) -> Tensor:
        """(B, F) -> (B,)."""
        action: Tensor = self.network.mean(features, self.levels).argmax(dim=-1)
        return action

    def facts(self) -> Mapping[str, str]:
        """See `Exportable`."""
        return {"policy": "iqn"}


class Iqn(OffPolicy[IqnConfig]):
    """IQN on a collector's rows; see `OffPolicy`."""

    losses = ("loss", "value", "exploration")
    actions = Discrete

    def build(self, features: int) -> None:
        """See `OffPolicy`."""
        config, self._choices = self._config, self._unit.size
        self.network = QuantileNetwork(
            features, self._choices, config.hidden, dueling=config.dueling, noise=config.noise
        ).to(self._device)
        self.target = deepcopy(self.network).requires_grad_(False)
        self.policy = self._own_policy = IqnPolicy(self.encoder, self.network, config.greedy_quantiles).to(self._device)
        self._target_policy = IqnPolicy(self.encoder, self.target, config.greedy_quantiles).to(self._device)
        self._parameters = [*self.encoder.parameters(), *self.network.parameters()]
        learned = parameter_groups(self.encoder, self.network)
        self._optimizer = torch.optim.Adam(learned, lr=config.learning_rate, fused=True)

    @property
    def exploration(self) -> float:
        """Present probability of a random action."""
        config = self._config
        share = self.steps / config.exploration_steps
        return linear(config.first_exploration, config.last_exploration, share)

    def explore(self, observation: TensorDictBase) -> dict[str, Tensor]:
        """The policy's action, or a random one."""
        self.network.renew_noise()
        greedy = self.policy(observation)
        drawn = torch.randint_like(greedy, self._choices)
        return {"action": torch.where(torch.rand(greedy.shape, device=greedy.device) < self.exploration, drawn, greedy)}

    def learn(self, batch: TensorDictBase) -> dict[str, Tensor]:
        """See `OffPolicy`."""
        self.network.renew_noise()
        self.target.renew_noise()
        levels = torch.rand(len(batch), self._config.quantiles, device=self._device)
        quantiles = _of_actions(self.network(self.encoder(batch["observation"]), levels), batch["action"])
        losses = quantile_huber(quantiles, levels, self.target_quantiles(batch), self._config.kappa)
        loss = weighted(losses, batch)
        self._optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self._parameters, self._config.gradient_norm)
        self._optimizer.step()
        if (self.updates + 1) % self._config.target_every == 0:
            soft_update(self.target, self.network, 1.0)
        self.replay.prioritise(batch["index"], losses)
        logged = (loss, quantiles.mean(), torch.tensor(self.exploration))
        return {name: value.detach() for name, value in zip(self.losses, logged, strict=True)}

    @torch.no_grad()
    def target_quantiles(self, batch: TensorDictBase) -> Tensor:
        """(B, N') r + gamma Z'(s', a'), at drawn levels, a' the best action of the target or learned network."""
        features = self.encoder(batch["next", "observation"])
        levels = torch.rand(len(batch), self._config.target_quantiles, device=self._device)
        chooser = self._own_policy if self._config.double else self._target_policy
        following = _of_actions(self.target(features, levels), chooser.greedy(features))
        target: Tensor = batch["next", "reward"] + self._discount(batch)[:, None] * following
        return target

    @property
    def parts(self) -> Mapping[str, Any]:
        """See `OffPolicy`."""
        modules = {"encoder": self.encoder, "network": self.network, "target": self.target}
        return modules | {"optimizer": self._optimizer}


def quantile_huber(quantiles: Tensor, levels: Tensor, targets: Tensor, kappa: float) -> Tensor:
    """Quantile Huber loss (Dabney et al. 2018, equations 2 and 3).

    Args:
        quantiles: (B, N) predicted.
        levels: (B, N) their levels in [0, 1].
        targets: (B, N') drawn from the target distribution.
        kappa: Where the loss becomes linear.

    Returns:
        (B,) sum over the predicted quantiles of the mean over the targets.
    """
    errors = targets[:, None, :] - quantiles[:, :, None]
    huber = nn.functional.huber_loss(errors, torch.zeros_like(errors), reduction="none", delta=kappa) / kappa
    return ((levels[:, :, None] - (errors < 0.0).float()).abs() * huber).mean(dim=2).sum(dim=1)


def _of_actions(quantiles: Tensor, actions: Tensor) -> Tensor:
    """(B, N, A) and (B,) -> (B, N)."""
    return quantiles.gather(2, actions[:, None, None].expand(-1, quantiles.shape[1], 1)).squeeze(2)
