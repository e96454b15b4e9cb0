"""DrQ-v2: DDPG with twin critics, returns of 3 steps, random shifts and falling noise. Source: Yarats et al. 2022.

Which loss moves what: as in `ddpg`, in one step, so that the actor follows the critics before they move. There is no
target actor; the noise of the target's action is clipped. Ours: no seed frames beyond `learning_starts`, an update at
every step, and the sizes below.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Annotated, Any

import torch
from pydantic import Field
from tensordict import TensorDictBase
from torch import Tensor

from dohyo.agents.learning.algorithms.ddpg import DdpgPolicy
from dohyo.agents.learning.algorithms.off_policy import OffPolicy, OffPolicyConfig, linear, weighted
from dohyo.agents.learning.experience.replay import ReplayConfig
from dohyo.agents.learning.networks.modules import Critics, DeterministicHead, frozen, soft_update
from dohyo.agents.learning.runs.config import Positive, Share
from dohyo.agents.perception.encoders.local_mixing import parameter_groups


class DrqV2Config(OffPolicyConfig):
    """Settings; the defaults are the source's, but for what the module names.

    Attributes:
        learning_rate: Of Adam, for everything.
        tau: Rate at which the target critics follow.
        hidden: Width of each hidden layer of actor and critics.
        first_noise: Standard deviation of the exploration at the start.
        last_noise: The same from `noise_steps` on; linear between.
        noise_steps: Environment steps (source: at least 100,000; a training here has fewer).
        noise_clip: Bound of the target action's noise.
    """

    replay: ReplayConfig = ReplayConfig(capacity=100_000, steps=3)
    batch: Positive = 64
    learning_rate: Annotated[float, Field(gt=0)] = 1e-4
    tau: Share = 0.01
    hidden: Annotated[tuple[Positive, ...], Field(min_length=1)] = (256, 256)
    first_noise: Annotated[float, Field(ge=0)] = 1.0
    last_noise: Annotated[float, Field(ge=0)] = 0.1
    noise_steps: Positive = 20_000
    noise_clip: Annotated[float, Field(gt=0)] = 0.3


class DrqV2(OffPolicy[DrqV2Config]):
    """See the module."""

    losses = ("loss_critic", "loss_actor", "noise")

    def build(self, features: int) -> None:
        """See `OffPolicy`."""
        config, actions = self._config, self._unit.size
        self.actor = DeterministicHead(features, actions, config.hidden).to(self._device)
        self.critics = Critics(features, actions, config.hidden, count=2).to(self._device)
        self.target = deepcopy(self.critics).requires_grad_(False)
        self.policy = DdpgPolicy(self.encoder, self.actor, self._unit)
        learned = parameter_groups(self.encoder, self.actor, self.critics)
        self._optimizer = torch.optim.Adam(learned, lr=config.learning_rate, fused=True)

    @property
    def noise(self) -> float:
        """Present standard deviation of the exploration."""
        config = self._config
        return linear(config.first_noise, config.last_noise, self.steps / config.noise_steps)

    def explore(self, observation: TensorDictBase) -> dict[str, Tensor]:
        """The policy's action with noise, clipped to the action space."""
        action: Tensor = self.actor(self.encoder(observation))
        return {"action": self._unit.inverse(action + self.noise * torch.randn_like(action))}

    def learn(self, batch: TensorDictBase) -> dict[str, Tensor]:
        """See `OffPolicy`."""
        features = self.encoder(batch["observation"])
        errors = self.critics(features, self._unit(batch["action"])) - self.target_values(batch)
        loss_critic = weighted(errors.square(), batch) * len(errors)
        loss_actor = self.actor_loss(features.detach(), batch)
        self._optimizer.zero_grad()
        (loss_critic + loss_actor).backward()  # type: ignore[no-untyped-call]
        self._optimizer.step()
        soft_update(self.target, self.critics, self._config.tau)
        self.replay.prioritise(batch["index"], errors.detach().abs().amax(dim=0))
        logged = (loss_critic.detach(), loss_actor.detach(), torch.tensor(self.noise))
        return dict(zip(self.losses, logged, strict=True))

    @torch.no_grad()
    def target_values(self, batch: TensorDictBase) -> Tensor:
        """(B,) sum of rewards + gamma^n min Q'(s', mu(s') + clipped noise)."""
        features = self.encoder(batch["next", "observation"])
        value = self.target(features, self._smoothed(self.actor(features))).amin(dim=0)
        target: Tensor = batch["next", "reward"].squeeze(-1) + self._discount(batch) * value
        return target

    def actor_loss(self, features: Tensor, batch: TensorDictBase) -> Tensor:
        """Mean of -min Q(s, mu(s) + clipped noise)."""
        with frozen(self.critics):
            return weighted(-self.critics(features, self._smoothed(self.actor(features))).amin(dim=0), batch)

    def _smoothed(self, action: Tensor) -> Tensor:
        """Action with clipped noise; the bound of the action space lets gradients through, as the source's does."""
        clip = self._config.noise_clip
        noisy = action + (self.noise * torch.randn_like(action)).clamp(-clip, clip)
        return noisy - noisy.detach() + noisy.detach().clamp(-1.0, 1.0)

    @property
    def parts(self) -> Mapping[str, Any]:
        """See `OffPolicy`."""
        modules = {"encoder": self.encoder, "actor": self.actor, "critics": self.critics, "target": self.target}
        return modules | {"optimizer": self._optimizer}
