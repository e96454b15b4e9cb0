"""Proximal policy optimisation (Schulman et al. 2017), and its guided variant GPPO (Albilani 2023).

GPPO: with probability p an expert drives an episode, which is stored as if the policy had driven it: the ratio uses the
probability of the expert's action under the current policy.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from gymnasium.spaces import Box, Discrete
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn
from torchrl.objectives.value.functional import generalized_advantage_estimate

from dohyo.agents.learning.algorithms.divergence import check_actions, check_finite
from dohyo.agents.learning.algorithms.intrinsic import IntrinsicReward, add_intrinsic
from dohyo.agents.learning.algorithms.ppo_config import PpoConfig, PpoRunConfig
from dohyo.agents.learning.experience.behaviour import DEMONSTRATOR, EpisodeMixture
from dohyo.agents.learning.experience.collector import Collector, Finished, outcome
from dohyo.agents.learning.files.metrics import Number
from dohyo.agents.learning.imitation.bco import Bco
from dohyo.agents.learning.imitation.dagger import WarmStart
from dohyo.agents.learning.networks.modules import ObservationEncoder, evaluating
from dohyo.agents.learning.networks.moments import Moments
from dohyo.agents.learning.networks.policy import (
    Actor,
    EncodedPolicy,
    PpoActor,
    actor_for,
    distribution_at,
    layers,
    normalised,
)
from dohyo.agents.learning.policies.export import Exportable
from dohyo.agents.learning.runs.run import TaskRun
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.learning.runs.training import train_task
from dohyo.agents.learning.tasks.task import Array, Task, named
from dohyo.agents.perception.encoders.local_mixing import parameter_groups
from dohyo.sumo_networks.errors import InvalidInputError

LOSSES = ("loss_objective", "loss_critic", "loss_entropy", "entropy", "kl_approx", "clip_fraction")

C = TypeVar("C", bound=PpoRunConfig)


def ppo_trainer(summary: str, config: type[C], task_of: Callable[[C], Task]) -> Trainer[C]:
    """A trainer that learns a task by PPO.

    Args:
        summary: Subject, in a few words.
        config: Its settings.
        task_of: The task of some settings.
    """

    def train_ppo(settings: C, request: TrainRequest) -> Path:
        task = task_of(settings)

        def learner(collector: Collector, run: TaskRun) -> Ppo:
            return Ppo(task, collector, settings.ppo, run.device, settings.seed)

        return train_task(learner, task, settings, request)

    return Trainer(summary, config, train_ppo)


class _Value(nn.Module):
    """Critic on features, with the actor's normalisation if it has one: the two share shift and scale."""

    def __init__(self, actor: nn.Module, sizes: Sequence[int]) -> None:
        super().__init__()
        self.body = layers((*sizes[:-1], 1), last_gain=1.0)
        self._normalised = isinstance(actor, Actor)
        if isinstance(actor, Actor):
            self.register_buffer("shift", actor.shift)
            self.register_buffer("scale", actor.scale)

    def forward(self, features: Tensor) -> Tensor:
        """(..., O) -> (..., 1)."""
        seen = normalised(features, self.shift, self.scale) if self._normalised else features  # type: ignore[arg-type]
        value: Tensor = self.body(seen)
        return value


class Ppo:
    """PPO on a collector's rows.

    Attributes:
        actor: The policy on features.
        policy: The policy on named observations, which is shipped.
        updates: Gradient steps so far.
        rounds: Rounds so far.
    """

    columns: tuple[str, ...] = (
        *("updates", "episodes", "level", "return", "length", "success", "guided_share", "guided_episodes"),
        *("guided_return", "guided_steps", "reward", "std", "learning_rate", "explained_variance", *LOSSES),
    )

    def __init__(
        self,
        task: Task,
        collector: Collector,
        config: PpoConfig,
        device: torch.device,
        seed: int = 0,
        encoder: nn.Module | None = None,
        intrinsic: Sequence[IntrinsicReward] = (),
        cloning: Bco | None = None,
    ) -> None:
        """Draws weights from torch's generator.

        Args:
            task: What is learned.
            collector: Of the task.
            config: Settings.
            device: Of networks and batches.
            seed: Of the run; it decides which episodes the expert drives.
            encoder: Named observations -> (..., `features`), learned with actor and critic; None: vectors are joined.
            intrinsic: Rewards beside the task's, such as `Gail` and `Icm`; returns are reported without them.
            cloning: Imitates demonstrations before the first round.

        Raises:
            InvalidInputError: A picture without an encoder, or settings that do not fit the action space or a task
                without an expert.
        """
        if (config.guided_share or config.imitated_steps) and not task.has_expert:
            raise InvalidInputError(
                f"task '{task.name}' has no expert; expected guided_share and imitated_steps of 0, "
                f"got {config.guided_share:g} and {config.imitated_steps}"
            )
        self._collector, self._config, self._device = collector, config, device
        self._intrinsic, self._cloning = intrinsic, cloning
        self.columns = (*type(self).columns, *(name for source in intrinsic for name in source.columns))
        space = named(task.observation_space)
        self._names = list(space.spaces)
        self.encoder = (encoder or ObservationEncoder(space)).to(device)
        features: int = self.encoder.features  # type: ignore[assignment]
        actor: Any = ppo_actor(features, task.action_space, config)
        self.actor = actor.to(device)
        self.policy: Exportable = self.actor if encoder is None else EncodedPolicy(self.encoder, self.actor)
        self._value = self._critic(task).to(device)
        self._moments = Moments(features)
        self.behaviour = EpisodeMixture(self._explore, seed, config.guided_share)
        learned: Any = parameter_groups(actor, self._value, self.encoder)
        self._parameters: list[nn.Parameter] = learned[0]["params"]  # of which the gradient's norm is bounded
        self._optimizer = torch.optim.Adam(learned, lr=config.learning_rate, fused=True)
        self._schedule = torch.optim.lr_scheduler.ExponentialLR(self._optimizer, config.learning_rate_decay)
        self._intrinsic_row: dict[str, Number] = {}
        self.updates, self.rounds = 0, 0

    def _critic(self, task: Task) -> nn.Module:
        """Critic on features."""
        return _Value(self.actor, self.actor.sizes)

    def begin(self) -> None:
        """Imitates the expert, or demonstrations, if that is set."""
        config = self._config

        def features(observation: TensorDictBase) -> Tensor:
            return self._features(observation.to(self._device))

        if config.imitated_steps:
            start = WarmStart(self.actor, self._value, features, self._collector, config.gamma, config.reward_scale)
            start.learn(config.imitated_steps, self._look_back)
            self._collector.begin()
        if self._cloning is not None:
            with torch.no_grad(), evaluating(self.encoder):
                self._look_back(features(self._cloning.demonstrations["observation"]))
            self._cloning.learn(self.actor, features, self._collector, self.behaviour)
            self._collector.begin()

    def round(self) -> dict[str, Number]:
        """Drives `horizon` steps everywhere, and learns from them.

        Returns:
            A row of metrics.csv.

        Raises:
            DohyoError: As from the collector; losses or actions are no longer finite.
        """
        share = self._config.guided_share_at(self.rounds)
        self.behaviour.share = share
        batch = self.collect()
        guided_steps = int((batch["source"] == DEMONSTRATOR).sum())
        row: dict[str, Number] = {"guided_share": share, "learning_rate": float(self._schedule.get_last_lr()[0])}
        mean = float(batch["next", "reward"][batch["active"]].mean())
        row |= _outcomes(self._collector.finished()) | {"level": self._collector.level}
        row |= {"guided_steps": guided_steps, "reward": mean / self._config.reward_scale}
        row |= self._intrinsic_row | self._learn(batch)
        self._schedule.step()
        self.rounds += 1
        if self._config.normalised and self._cloning is None:  # a cloned policy would change with the normalisation
            with torch.no_grad(), evaluating(self.encoder):
                seen = self._features(batch["observation"])[batch["active"]]
            self._look_back(seen)
        std = float(self.actor.log_std.detach().exp().mean()) if isinstance(self.actor, Actor) else None
        return row | {"std": std, "updates": self.updates, "episodes": self._collector.finished_count}

    def collect(self) -> TensorDict:
        """A round: (N, T) transitions with advantages."""
        steps = [self._collector.step(self.behaviour) for _ in self._collector.round(self._config.horizon)]
        batch = TensorDict.stack(steps, dim=1).to(self._device)
        self._intrinsic_row = add_intrinsic(self._intrinsic, batch)
        guided = batch["source"] == DEMONSTRATOR
        variable = batch.pop("variable")
        variable[guided] = self.actor.variable_of(batch["action"][guided])
        batch["action"] = variable
        batch["next", "reward"] *= self._config.reward_scale
        with torch.no_grad(), evaluating(self.encoder):
            self._judge(batch)
        return batch

    def _judge(self, batch: TensorDict) -> None:
        """Adds the executed actions' density, the critic's values, and the generalised advantage."""
        config, after = self._config, batch["next"]
        features = self._features(batch["observation"])
        # Density of the executed action, chosen by policy or expert: GPPO's "as if on-policy".
        distribution = distribution_at(self.actor, features)
        batch["action_log_prob"] = distribution.log_prob(batch["action"])
        batch["state_value"] = self._value(features)
        done = after["done"].clone()
        done[:, :-1] |= ~batch["active"][:, 1:, None]  # a lost step tells nothing: the critic judges what came after
        batch["advantage"], batch["value_target"] = generalized_advantage_estimate(
            config.gamma,
            config.gae_lambda,
            batch["state_value"],
            self._value(self._features(after["observation"])),
            after["reward"],
            done,
            after["terminated"],
            time_dim=1,
        )

    def act(self, observation: TensorDict) -> Array:
        """See `Learner`."""
        with torch.no_grad(), evaluating(self.encoder):
            action = np.asarray(self.actor(self._features(observation.to(self._device))).cpu().numpy())
        check_actions(action, observation)
        return action

    def state(self) -> dict[str, Any]:
        """State for a checkpoint."""
        return {
            "actor": self.actor.state_dict(),
            "encoder": self.encoder.state_dict(),
            "critic": self._value.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "schedule": self._schedule.state_dict(),
            "updates": self.updates,
            "rounds": self.rounds,
            "moments": self._moments.state(),
            "intrinsic": [source.state() for source in self._intrinsic],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state."""
        self.actor.load_state_dict(state["actor"])
        self.encoder.load_state_dict(state["encoder"])
        self._value.load_state_dict(state["critic"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._schedule.load_state_dict(state["schedule"])
        self.updates, self.rounds = state["updates"], state["rounds"]
        self._moments.restore(state["moments"])
        for source, kept in zip(self._intrinsic, state["intrinsic"], strict=True):
            source.restore(kept)

    def _explore(self, observation: TensorDict) -> TensorDict:
        """Draws actions; the variable of each is kept, since actions may be clipped."""
        with torch.no_grad(), evaluating(self.encoder):
            variable = self.actor.sample(self._features(observation.to(self._device)))
            chosen = {"action": self.actor.action_of(variable).cpu(), "variable": variable.cpu()}
        check_actions(chosen["action"].numpy(), observation)
        return TensorDict(chosen, observation.batch_size)

    def _features(self, observation: TensorDict) -> Tensor:
        features: Tensor = self.encoder({name: observation[name] for name in self._names})
        return features

    def _look_back(self, seen: Tensor) -> None:
        """Updates the normalisation with (B, O) features."""
        if self._config.normalised:
            self._moments.add(seen)
            self.actor.normalise(self._moments.mean, self._moments.scale)

    def _learn(self, batch: TensorDict) -> dict[str, Number]:
        """Several epochs over a round; means of the losses, and the variance that the critic explained."""
        data = batch.reshape(-1)
        if not data["active"].all():
            data = data[data["active"]]
        # Rare infractions are in few rows; in a batch without one, normalised noise would count as much.
        if len(data) > 1:  # a single one has no variance
            advantage = data["advantage"]
            data["advantage"] = (advantage - advantage.mean()) / advantage.std().clamp(min=1e-6)
        row: dict[str, Number] = {"explained_variance": explained_variance(data["state_value"], data["value_target"])}
        seen = {name: data["observation", name] for name in self._names}
        targets = [data[name] for name in ("action", "action_log_prob", "advantage", "value_target")]

        def losses(rows: Tensor) -> dict[str, Tensor]:
            return self._losses({name: one[rows] for name, one in seen.items()}, *(one[rows] for one in targets))

        return row | self._descend(len(data), self._config.batch, losses)

    def _descend(self, count: int, batch: int, losses_of: Callable[[Tensor], dict[str, Tensor]]) -> dict[str, Number]:
        """Takes gradient steps on batches of `count` rows, in several epochs; means of the losses.

        Raises:
            DohyoError: They are no longer finite.
        """
        sums, before = defaultdict[str, float](float), self.updates
        for _ in range(self._config.epochs):
            for rows in torch.split(torch.randperm(count), batch):
                losses = losses_of(rows.to(self._device))
                total = losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]
                self._optimizer.zero_grad(set_to_none=True)
                total.backward()  # type: ignore[no-untyped-call]
                nn.utils.clip_grad_norm_(self._parameters, self._config.gradient_norm)
                self._optimizer.step()
                self.updates += 1
                for name in LOSSES:
                    sums[name] += losses[name].item()
        means: dict[str, Number] = {name: value / (self.updates - before) for name, value in sums.items()}
        check_finite({name: sums[name] for name in LOSSES[:3]})
        return means

    def _losses(
        self, observation: Mapping[str, Tensor], action: Tensor, log_prob: Tensor, advantage: Tensor, target: Tensor
    ) -> dict[str, Tensor]:
        """TorchRL's ClipPPOLoss, which a test compares; that class takes 2.9 times as long on small networks."""
        features = self.encoder(observation)
        loss_critic = self._config.value_scale * nn.functional.smooth_l1_loss(self._value(features), target)
        return self._policy_losses(features, action, log_prob, advantage[:, 0]) | {"loss_critic": loss_critic}

    def _policy_losses(self, features: Tensor, action: Tensor, log_prob: Tensor, gain: Tensor) -> dict[str, Tensor]:
        """Losses of the actor at (B, O) features, with (B,) densities before the update and (B,) advantages."""
        config, distribution = self._config, distribution_at(self.actor, features)
        log_ratio = distribution.log_prob(action) - log_prob
        ratio = log_ratio.exp()
        clipped = ratio.clamp(1.0 - config.clip, 1.0 + config.clip)
        entropy = _entropy(distribution)
        return {
            "loss_objective": -torch.min(ratio * gain, clipped * gain).mean(),
            "loss_entropy": -config.entropy * entropy,
            "entropy": entropy.detach(),
            "kl_approx": -log_ratio.detach().mean(),
            "clip_fraction": (ratio.detach() != clipped.detach()).float().mean(),
        }


def ppo_actor(features: int, actions: Box | Discrete, config: PpoConfig) -> PpoActor:
    """An untrained actor of some settings, see `actor_for`; InvalidInputError if they do not fit the actions."""
    actor = actor_for(features, actions, config.hidden, config.initial_std, config.squashed)
    if config.normalised and not isinstance(actor, Actor):
        raise InvalidInputError("expected normalised = false with squashed or discrete actions")
    return actor


def _entropy(distribution: torch.distributions.Distribution) -> Tensor:
    """Mean entropy of a batch; estimated by one sample where there is no formula, as for squashed Gaussians."""
    try:
        return distribution.entropy().mean()
    except NotImplementedError:
        return -distribution.log_prob(distribution.rsample()).mean()


def _outcomes(finished: Sequence[Finished]) -> dict[str, Number]:
    """Results of the episodes of a round, separately for policy and expert."""
    own = [episode for episode in finished if not episode.demonstrated]
    guided = [episode for episode in finished if episode.demonstrated]
    return outcome(own) | {"guided_episodes": len(guided), "guided_return": outcome(guided)["return"]}


def explained_variance(value: Tensor, target: Tensor) -> float | None:
    """Share of the targets' variance that the values explain; None where there is none."""
    variance = float(target.var())
    return 1.0 - float((target - value).var()) / variance if np.isfinite(variance) and variance > 1e-12 else None
