"""Soft actor-critic (Haarnoja et al. 2018): twin critics, squashed Gaussian actor, learned temperature.

Which loss moves what: the Bellman error moves the critics and the encoder; the soft value moves the actor, on features
without gradient; the distance of the entropy to its target moves the temperature. Auxiliary losses, such as a
reconstruction, see the features of the same batch, and move the encoder and what they have themselves.

The losses are those of TorchRL's SACLoss (a test compares them); that class takes 1.4 times as long for an update.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Annotated, Any

import torch
from pydantic import Field
from tensordict import TensorDictBase
from torch import Tensor, nn

from dohyo.agents.learning.algorithms.off_policy import OffPolicy, OffPolicyConfig, weighted
from dohyo.agents.learning.networks.distributions import squashed_gaussian
from dohyo.agents.learning.networks.modules import Critics, GaussianHead, frozen, soft_update
from dohyo.agents.learning.networks.vectors import ActionVector
from dohyo.agents.learning.runs.config import Positive, Share
from dohyo.agents.perception.encoders.local_mixing import parameter_groups


class SacConfig(OffPolicyConfig):
    """Settings; the defaults are those of stable-baselines3.

    Attributes:
        learning_rate: Of Adam, for everything.
        tau: Rate at which the target critics follow.
        entropy_target: Per dimension of the action, where the action space is [-1, 1].
        initial_alpha: Temperature at the start.
        hidden: Width of each hidden layer of actor and critics.
    """

    learning_rate: Annotated[float, Field(gt=0)] = 3e-4
    tau: Share = 0.005
    entropy_target: float = -1.0
    initial_alpha: Annotated[float, Field(gt=0)] = 1.0
    hidden: Annotated[tuple[Positive, ...], Field(min_length=1)] = (256, 256)


class Auxiliary(nn.Module):
    """A loss beside those of SAC, with the networks that it needs.

    Attributes:
        name: Of its column in metrics.csv.
    """

    name: str

    def forward(self, batch: TensorDictBase, features: Tensor) -> Tensor:
        """The loss.

        Args:
            batch: (B,) transitions.
            features: (B, F) of their observations, with gradient to the encoder.
        """
        raise NotImplementedError

    def follow(self) -> None:
        """Moves what follows the learned networks, after each gradient step."""


class SacPolicy(nn.Module):
    """Observations by name -> the squashed mean, in the action space."""

    def __init__(self, encoder: nn.Module, head: GaussianHead, space: ActionVector) -> None:
        super().__init__()
        self.encoder, self.head, self.space = encoder, head, space

    def forward(self, observation: Mapping[str, Tensor]) -> Tensor:
        """(B, ...) by name -> (B, A)."""
        return self.space.inverse(self.head.centre(self.encoder(observation)))

    def facts(self) -> Mapping[str, str]:
        """See `Exportable`."""
        return {"policy": "sac"}


class Sac(OffPolicy[SacConfig]):
    """SAC on a collector's rows; see `OffPolicy`."""

    losses = ("loss_critic", "loss_actor", "loss_alpha", "alpha", "entropy")

    def __init__(self, *args: Any, auxiliary: Sequence[Auxiliary] = (), **options: Any) -> None:
        """See `OffPolicy`; `auxiliary` losses are on the device."""
        self.auxiliary = nn.ModuleList(auxiliary)
        super().__init__(*args, **options)

    @property
    def columns(self) -> tuple[str, ...]:
        """See `OffPolicy`."""
        return (*super().columns, *(one.name for one in self._auxiliary))

    @property
    def _auxiliary(self) -> list[Auxiliary]:
        return [one for one in self.auxiliary if isinstance(one, Auxiliary)]

    def make_actor(self, features: int) -> GaussianHead:
        """The actor on `features` numbers."""
        return GaussianHead(features, self._unit.size, self._config.hidden)

    def build(self, features: int) -> None:
        """See `OffPolicy`."""
        config, actions = self._config, self._unit.size
        self.actor = self.make_actor(features).to(self._device)
        self.critics = Critics(features, actions, config.hidden, count=2).to(self._device)
        self.target = deepcopy(self.critics).requires_grad_(False)
        self.log_alpha = nn.Parameter(torch.tensor(config.initial_alpha, device=self._device).log())
        self.policy = SacPolicy(self.encoder, self.actor, self._unit)
        alpha = nn.ParameterList([self.log_alpha])
        learned = parameter_groups(self.encoder, self.actor, self.critics, alpha, self.auxiliary)
        self._optimizer = torch.optim.Adam(learned, lr=config.learning_rate, fused=True)

    def explore(self, observation: TensorDictBase) -> dict[str, Tensor]:
        """Draws from the policy."""
        action, _ = squashed_gaussian(*self.actor(self.encoder(observation)))
        return {"action": self._unit.inverse(action)}

    def learn(self, batch: TensorDictBase) -> dict[str, Tensor]:
        """See `OffPolicy`."""
        return self.learn_towards(batch, self.target_values(batch, self.log_alpha.detach().exp()))

    def learn_towards(self, batch: TensorDictBase, targets: Tensor) -> dict[str, Tensor]:
        """One gradient step; `targets` (B,) are those of the critics, see `target_values`."""
        features, action = self.encoder(batch["observation"]), self._unit(batch["action"])
        alpha = self.log_alpha.detach().exp()
        errors = self.critics(features, action) - targets
        loss_critic = weighted(errors.square(), batch) * len(errors)
        loss_actor, entropy = self.actor_loss(features.detach(), alpha, batch)
        target_entropy = self._config.entropy_target * action.shape[-1]
        loss_alpha = self.log_alpha * (entropy - target_entropy)
        beside = {one.name: one(batch, features) for one in self._auxiliary}
        self._optimizer.zero_grad()
        sum(beside.values(), start=loss_critic + loss_actor + loss_alpha).backward()
        self._optimizer.step()
        soft_update(self.target, self.critics, self._config.tau)
        for one in self._auxiliary:
            one.follow()
        self.replay.prioritise(batch["index"], errors.detach().abs().amax(dim=0))
        logged = (loss_critic, loss_actor, loss_alpha, alpha, entropy)
        named = {**dict(zip(self.losses, logged, strict=True)), **beside}
        return {name: value.detach() for name, value in named.items()}

    @torch.no_grad()
    def target_values(self, batch: TensorDictBase, alpha: Tensor) -> Tensor:
        """(B,) r + gamma (min Q'(s', a') - alpha log pi(a' | s')), a' drawn from the policy."""
        features = self.encoder(batch["next", "observation"])
        action, log_density = squashed_gaussian(*self.actor(features))
        soft_value = self.target(features, action).amin(dim=0) - alpha * log_density
        target: Tensor = batch["next", "reward"].squeeze(-1) + self._discount(batch) * soft_value
        return target

    def actor_loss(self, features: Tensor, alpha: Tensor, batch: TensorDictBase) -> tuple[Tensor, Tensor]:
        """Mean of alpha log pi(a | s) - min Q(s, a), a drawn from the policy; and the policy's entropy."""
        action, log_density = squashed_gaussian(*self.actor(features))
        with frozen(self.critics):
            values = self.critics(features, action).amin(dim=0)
        return weighted(alpha * log_density - values, batch), -log_density.detach().mean()

    @property
    def parts(self) -> Mapping[str, Any]:
        """See `OffPolicy`."""
        modules = {"encoder": self.encoder, "actor": self.actor, "critics": self.critics, "target": self.target}
        auxiliary = {"auxiliary": self.auxiliary} if len(self.auxiliary) else {}
        return modules | auxiliary | {"alpha": nn.ParameterList([self.log_alpha]), "optimizer": self._optimizer}
