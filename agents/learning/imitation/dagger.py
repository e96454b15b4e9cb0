"""DAgger: dataset aggregation (Ross et al. 2011). The policy drives, the expert labels every step, all labels are kept.

`Dagger` learns a policy this way, from the first step to the last. `WarmStart` does it before the first round of PPO,
and fits the critic, too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import torch
from pydantic import Field
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn

from dohyo.agents.learning.experience.behaviour import DEMONSTRATOR, POLICY, EpisodeMixture
from dohyo.agents.learning.experience.collector import Collector, outcome
from dohyo.agents.learning.files.metrics import Number
from dohyo.agents.learning.imitation.behaviour_cloning import ImitatingPolicy, Labels, PolicyConfig, cloning_loss
from dohyo.agents.learning.networks.policy import Actor
from dohyo.agents.learning.policies.export import Exportable
from dohyo.agents.learning.runs.config import Positive, RunConfig
from dohyo.agents.learning.runs.run import TaskRun
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.learning.runs.training import train_task
from dohyo.agents.learning.tasks.task import Array, Task
from dohyo.sumo_networks.arrays import BoolArray, IntArray
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError


class DaggerConfig(Config):
    """Settings of DAgger; the paper leaves the numbers to the problem.

    Attributes:
        policy: The policy and its loss, the table [policy].
        horizon: Steps of every environment between two fits: a round.
        expert_decay: The expert drives an episode of round i with probability expert_decay^i; the policy the others.
        passes: Passes over all labels per round.
        batch: Labels in a gradient step.
        learning_rate: Of AdamW.
        weight_decay: Of AdamW.
    """

    policy: PolicyConfig = PolicyConfig()
    horizon: Positive = 256
    expert_decay: Annotated[float, Field(ge=0, le=1)] = 0.5
    passes: Positive = 4
    batch: Positive = 128
    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    weight_decay: Annotated[float, Field(ge=0)] = 1e-4


class Dagger:
    """Learner of the task's expert.

    Its labels are part of a checkpoint: vectors are small, pictures of many steps are not.

    Attributes:
        policy: The policy on named observations, which is shipped.
        updates: Gradient steps so far.
    """

    columns = ("updates", "episodes", "return", "length", "success", "expert_share", "labels", "loss")

    def __init__(
        self,
        task: Task,
        collector: Collector,
        config: DaggerConfig,
        device: torch.device,
        seed: int = 0,
        encoder: nn.Module | None = None,
    ) -> None:
        """Draws weights from torch's generator.

        Args:
            task: With an expert.
            collector: Of the task.
            config: Settings.
            device: Of the networks.
            seed: Of the run; it decides which episodes the expert drives.
            encoder: See `ImitatingPolicy`.

        Raises:
            InvalidInputError: The task has no expert, or its spaces do not fit the settings.
        """
        if not task.has_expert:
            raise InvalidInputError(f"task '{task.name}' has no expert, which DAgger asks at every step")
        self._collector, self._config = collector, config
        self._imitating = ImitatingPolicy(task, config.policy, encoder).to(device)
        self.policy: Exportable = self._imitating.exported
        self._optimizer = torch.optim.AdamW(
            self._imitating.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
        )
        self._labels = Labels()
        self.behaviour = EpisodeMixture(self._drive, seed, share=1.0, labels=True)
        self.updates, self.rounds = 0, 0

    def begin(self) -> None:
        """See `Learner`."""

    def round(self) -> dict[str, Number]:
        """Drives `horizon` steps everywhere, and fits the policy to all labels; row of metrics.csv."""
        config = self._config
        self.behaviour.share = config.expert_decay**self.rounds
        steps = [self._collector.step(self.behaviour) for _ in self._collector.round(config.horizon)]
        self._labels.add(TensorDict.stack(steps, dim=1))
        loss = None
        if len(self._labels):
            loss = self._labels.fit(self._optimizer, self._loss, config.passes, config.batch)
            self.updates += config.passes * -(-len(self._labels) // config.batch)
        self.rounds += 1
        own = [episode for episode in self._collector.finished() if not episode.demonstrated]
        row: dict[str, Number] = {"updates": self.updates, "episodes": self._collector.finished_count}
        return row | outcome(own) | {"expert_share": self.behaviour.share, "labels": len(self._labels), "loss": loss}

    def act(self, observation: TensorDict) -> Array:
        """See `Learner`."""
        return self._imitating.act(observation)

    def state(self) -> dict[str, Any]:
        """State for a checkpoint."""
        return {
            "policy": self._imitating.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "labels": self._labels.rows.to_dict(),
            "updates": self.updates,
            "rounds": self.rounds,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state."""
        self._imitating.load_state_dict(state["policy"])
        self._optimizer.load_state_dict(state["optimizer"])
        rows = state["labels"]
        self._labels.rows = TensorDict(rows, [len(rows["label"]) if rows else 0])
        self.updates, self.rounds = state["updates"], state["rounds"]

    def _drive(self, observation: TensorDict) -> TensorDict:
        return TensorDict({"action": torch.from_numpy(self.act(observation))}, observation.batch_size)

    def _loss(self, rows: TensorDictBase) -> Tensor:
        return self._imitating.loss(rows["observation"], rows["label"])


class DaggerRunConfig(RunConfig):
    """A run of DAgger; a trainer derives from it and adds the settings of its task.

    Attributes:
        dagger: The algorithm's settings, the table [dagger].
    """

    dagger: DaggerConfig = DaggerConfig()


C = TypeVar("C", bound=DaggerRunConfig)


def dagger_trainer(summary: str, config: type[C], task_of: Callable[[C], Task]) -> Trainer[C]:
    """A trainer that learns a task's expert by DAgger.

    Args:
        summary: Subject, in a few words.
        config: Its settings.
        task_of: The task of some settings.
    """

    def train_dagger(settings: C, request: TrainRequest) -> Path:
        task = task_of(settings)

        def learner(collector: Collector, run: TaskRun) -> Dagger:
            return Dagger(task, collector, settings.dagger, run.device, settings.seed)

        return train_task(learner, task, settings, request)

    return Trainer(summary, config, train_dagger)


class WarmStart:
    """Fits PPO's actor and critic to the expert, before the first round.

    The first part is driven by the expert, the others by the actor, all with the actor's noise. The numbers are ours.
    """

    PARTS = 6
    PASSES, LAST_PASSES = 10, 30
    BATCH, LEARNING_RATE, LAST_LEARNING_RATE = 128, 1e-3, 2e-4
    WEIGHT_DECAY = 0.3  # against overfitting: there are many steps, but few episodes

    def __init__(
        self,
        actor: Actor,
        critic: nn.Module,
        features: Callable[[TensorDictBase], Tensor],
        collector: Collector,
        gamma: float,
        scale: float,
    ) -> None:
        """Prepares.

        Args:
            actor: Its mean is fitted to the expert.
            critic: (B, O) -> (B, 1), fitted to the discounted returns.
            features: Named observations (B, *) -> (B, O), on the networks' device.
            collector: Of the training; its expert is asked at every step.
            gamma: Discount per step.
            scale: Of the rewards.
        """
        self._actor, self._critic, self._features, self._collector = actor, critic, features, collector
        self._gamma, self._scale = gamma, scale
        self.labels = Labels()
        fitted = [*actor.body.parameters(), *critic.parameters()]
        self._optimizer = torch.optim.AdamW(fitted, weight_decay=self.WEIGHT_DECAY)

    def learn(self, steps: int, look: Callable[[Tensor], None]) -> None:
        """Collects labels and learns from them.

        Args:
            steps: Of all environments together.
            look: Called with the (B, O) features of each part, before they are learned.
        """
        length = max(steps // (self.PARTS * len(self._collector)), 1)
        for part in range(self.PARTS):
            if len(new := self._collect(length, follow=part == 0)):
                look(self._features(new["observation"]))
                self._fit(self.PASSES, self.LEARNING_RATE)
        if len(self.labels):
            self._fit(self.LAST_PASSES, self.LAST_LEARNING_RATE)

    def _collect(self, length: int, follow: bool) -> TensorDictBase:
        """Drives as the expert or as the actor does; returns the new labels."""
        driver = _Noisy(self._actor, self._features, follow)
        steps = TensorDict.stack([self._collector.step(driver) for _ in range(length)], dim=1)
        self._collector.finished()
        rewards = steps["next", "reward"][..., 0].double() * self._scale
        return self.labels.add(steps, returns=self._returns(rewards, steps["next"]).float())

    @torch.no_grad()
    def _returns(self, rewards: Tensor, after: TensorDictBase) -> Tensor:
        """(N, T) discounted future rewards; the critic gives the value after the last step and after a time limit."""
        ended, terminated = after["done"][..., 0], after["terminated"][..., 0]
        beyond, cut = torch.zeros_like(rewards), ended & ~terminated
        if cut.any():
            beyond[cut] = self._critic(self._features(after["observation"][cut]))[:, 0].cpu().double()
        value = self._critic(self._features(self._collector.seen))[:, 0].cpu().double()
        returns = torch.zeros_like(rewards)
        for step in reversed(range(rewards.shape[1])):
            value = rewards[:, step] + self._gamma * torch.where(ended[:, step], beyond[:, step], value)
            returns[:, step] = value
        return returns

    def _fit(self, passes: int, rate: float) -> None:
        self._optimizer.param_groups[0]["lr"] = rate
        self.labels.fit(self._optimizer, self._loss, passes, self.BATCH)

    def _loss(self, rows: TensorDictBase) -> Tensor:
        features = self._features(rows["observation"])
        value = self._critic(features)[:, 0]
        loss = cloning_loss(self._actor, features, rows["label"].to(features.device), "huber")
        return loss + 0.1 * nn.functional.smooth_l1_loss(value, rows["returns"].to(features.device))


class _Noisy:
    """Behaviour that drives as the expert, or as the actor, with the actor's noise; it asks the expert every time."""

    def __init__(self, actor: Actor, features: Callable[[TensorDictBase], Tensor], follow: bool) -> None:
        self._actor, self._features, self._follow = actor, features, follow

    def begin(self, rows: BoolArray, episodes: IntArray) -> None:
        """See `Behaviour`."""

    def asked(self, count: int) -> BoolArray:
        """See `Behaviour`."""
        return np.ones(count, np.bool_)

    @torch.no_grad()
    def act(self, observation: TensorDict, label: Tensor, labelled: Tensor) -> TensorDict:
        """See `Behaviour`."""
        mean, std = self._actor.gaussian(self._features(observation))
        if self._follow:
            mean = torch.where(labelled.to(mean.device)[:, None], self._actor.unscaled(label.to(mean.device)), mean)
        action = self._actor.scaled(torch.normal(mean, std)).cpu()
        source = torch.full(observation.batch_size, DEMONSTRATOR if self._follow else POLICY, dtype=torch.uint8)
        return TensorDict({"action": action, "source": source}, observation.batch_size)
