"""Deep deterministic policy gradient (Lillicrap et al. 2016): a critic, a deterministic actor, and targets of both.

Which loss moves what: the Bellman error moves the critic and the encoder; the value of the critic that has moved moves
the actor, on features without gradient.

The losses are those of TorchRL's DDPGLoss, and the updates those of stable-baselines3 (tests compare both). They are
written plainly for the reason given in `sac`.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Annotated, Any

import torch
from pydantic import Field
from tensordict import TensorDictBase
from torch import Tensor, nn

from dohyo.agents.learning.algorithms.off_policy import OffPolicy, OffPolicyConfig, weighted
from dohyo.agents.learning.networks.modules import Critics, DeterministicHead, frozen, soft_update
from dohyo.agents.learning.networks.vectors import ActionVector
from dohyo.agents.learning.runs.config import Positive, Share
from dohyo.agents.perception.encoders.local_mixing import parameter_groups


class DdpgConfig(OffPolicyConfig):
    """Settings; the defaults are those of stable-baselines3, whose noise is 0 unless it is given one.

    Attributes:
        learning_rate: Of Adam, for everything.
        tau: Rate at which the targets follow.
        noise: Standard deviation of the exploration, where the action space is [-1, 1] (Fujimoto et al. 2018: 0.1).
        hidden: Width of each hidden layer of actor and critic.
    """

    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    tau: Share = 0.005
    noise: Annotated[float, Field(ge=0)] = 0.1
    hidden: Annotated[tuple[Positive, ...], Field(min_length=1)] = (400, 300)


class DdpgPolicy(nn.Module):
    """Observations by name -> action, in the action space."""

    def __init__(self, encoder: nn.Module, head: DeterministicHead, space: ActionVector) -> None:
        super().__init__()
        self.encoder, self.head, self.space = encoder, head, space

    def forward(self, observation: Mapping[str, Tensor]) -> Tensor:
        """(B, ...) by name -> (B, A)."""
        return self.space.inverse(self.head(self.encoder(observation)))

    def facts(self) -> Mapping[str, str]:
        """See `Exportable`."""
        return {"policy": "ddpg"}


class Ddpg(OffPolicy[DdpgConfig]):
    """DDPG on a collector's rows; see `OffPolicy`."""

    losses = ("loss_critic", "loss_actor", "value")

    def build(self, features: int) -> None:
        """See `OffPolicy`."""
        config, actions = self._config, self._unit.size
        self.actor = DeterministicHead(features, actions, config.hidden).to(self._device)
        self.critic = Critics(features, actions, config.hidden, count=1).to(self._device)
        self.target_actor = deepcopy(self.actor).requires_grad_(False)
        self.target_critic = deepcopy(self.critic).requires_grad_(False)
        self.policy = DdpgPolicy(self.encoder, self.actor, self._unit)
        critic, actor = parameter_groups(self.encoder, self.critic), parameter_groups(self.actor)
        self._critic_optimizer = torch.optim.Adam(critic, lr=config.learning_rate, fused=True)
        self._actor_optimizer = torch.optim.Adam(actor, lr=config.learning_rate, fused=True)

    def explore(self, observation: TensorDictBase) -> dict[str, Tensor]:
        """The policy's action with noise, clipped to the action space."""
        action: Tensor = self.actor(self.encoder(observation))
        return {"action": self._unit.inverse(action + self._config.noise * torch.randn_like(action))}

    def learn(self, batch: TensorDictBase) -> dict[str, Tensor]:
        """See `OffPolicy`."""
        features = self.encoder(batch["observation"])
        values = self.critic(features, self._unit(batch["action"]))[0]
        errors = values - self.target_values(batch)
        loss_critic = weighted(errors.square(), batch)
        _step(self._critic_optimizer, loss_critic)
        loss_actor = self.actor_loss(features.detach(), batch)
        _step(self._actor_optimizer, loss_actor)
        soft_update(self.target_actor, self.actor, self._config.tau)
        soft_update(self.target_critic, self.critic, self._config.tau)
        self.replay.prioritise(batch["index"], errors)
        logged = (loss_critic, loss_actor, values.mean())
        return {name: value.detach() for name, value in zip(self.losses, logged, strict=True)}

    @torch.no_grad()
    def target_values(self, batch: TensorDictBase) -> Tensor:
        """(B,) r + gamma Q'(s', mu'(s'))."""
        features = self.encoder(batch["next", "observation"])
        value = self.target_critic(features, self.target_actor(features))[0]
        target: Tensor = batch["next", "reward"].squeeze(-1) + self._discount(batch) * value
        return target

    def actor_loss(self, features: Tensor, batch: TensorDictBase) -> Tensor:
        """Mean of -Q(s, mu(s))."""
        with frozen(self.critic):
            return weighted(-self.critic(features, self.actor(features))[0], batch)

    @property
    def parts(self) -> Mapping[str, Any]:
        """See `OffPolicy`."""
        modules = {"encoder": self.encoder, "actor": self.actor, "critic": self.critic}
        targets = {"target_actor": self.target_actor, "target_critic": self.target_critic}
        optimizers = {"critic_optimizer": self._critic_optimizer, "actor_optimizer": self._actor_optimizer}
        return modules | targets | optimizers


def _step(optimizer: torch.optim.Optimizer, loss: Tensor) -> None:
    optimizer.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]
    optimizer.step()
