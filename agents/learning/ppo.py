"""Proximal policy optimisation (Schulman et al. 2017) with TorchRL, and its guided variant GPPO (Albilani 2023).

GPPO: with probability p an expert drives an episode, which is stored as if the policy had driven it: the ratio uses the
probability of the expert's action under the current policy.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.modules import IndependentNormal, ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from dohyo.agents.learning.config import PpoConfig, PpoRunConfig
from dohyo.agents.learning.environments import Environments, Finished, Transition
from dohyo.agents.learning.imitation import Imitation
from dohyo.agents.learning.metrics import Number
from dohyo.agents.learning.moments import Moments
from dohyo.agents.learning.policy import Actor, actor_for, layers, normalised
from dohyo.agents.learning.registry import Trainer, TrainRequest
from dohyo.agents.learning.run import Run
from dohyo.agents.learning.task import Array, Task
from dohyo.agents.learning.training import train

LOSSES = ("loss_objective", "loss_critic", "loss_entropy", "entropy", "kl_approx", "clip_fraction")


C = TypeVar("C", bound=PpoRunConfig)


def ppo_trainer(summary: str, config: type[C], task_of: Callable[[C], Task]) -> Trainer[C]:
    """A trainer that learns a task by PPO.

    Args:
        summary: Subject, in a few words.
        config: Its settings.
        task_of: The task of some settings.
    """

    def train_ppo(settings: C, order: TrainRequest) -> Path:
        task, run = task_of(settings), Run(order.name, order.out, settings, order.resume)
        try:
            train(lambda environments, device: Ppo(task, environments, settings.ppo, device), task, run, order.report)
        finally:
            run.close()
        return run.folder / "best.safetensors"

    return Trainer(summary, config, train_ppo)


class _Gaussian(nn.Module):
    """Actor in TorchRL's form: observation -> loc, scale."""

    def __init__(self, actor: Actor) -> None:
        super().__init__()
        self.actor = actor

    def forward(self, observation: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return self.actor.gaussian(observation)


class _Value(nn.Module):
    """Critic with the actor's normalisation: the two share shift and scale."""

    shift: torch.Tensor
    scale: torch.Tensor

    def __init__(self, actor: Actor) -> None:
        super().__init__()
        self.body = layers((*actor.sizes[:-1], 1), last_gain=1.0)
        self.register_buffer("shift", actor.shift)
        self.register_buffer("scale", actor.scale)

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        value: torch.Tensor = self.body(normalised(observation, self.shift, self.scale))
        return value


class Ppo:
    """PPO on a task's environments.

    Attributes:
        actor: The policy.
        updates: Gradient steps so far.
        rounds: Rounds so far.
    """

    columns = (
        *("updates", "episodes", "return", "length", "success", "guided_share", "guided_episodes", "guided_return"),
        *("guided_steps", "reward", "std", "learning_rate", "explained_variance", *LOSSES),
    )

    def __init__(self, task: Task, environments: Environments, config: PpoConfig, device: torch.device) -> None:
        """Draws weights from torch's generator.

        Args:
            task: What is learned.
            environments: Of the task.
            config: Settings.
            device: Of networks and batches.

        Raises:
            InvalidInputError: The task's observations or actions are not vectors.
        """
        self._environments, self._config, self._device = environments, config, device
        self.actor = actor_for(task.observation_space, task.action_space, config.hidden, config.initial_std).to(device)
        self._value = _Value(self.actor).to(device)
        self._critic = ValueOperator(self._value, in_keys=["observation"])
        self._moments = Moments(self.actor.sizes[0])
        self._policy = ProbabilisticActor(
            TensorDictModule(_Gaussian(self.actor), in_keys=["observation"], out_keys=["loc", "scale"]),
            in_keys=["loc", "scale"],
            distribution_class=IndependentNormal,
            return_log_prob=True,
        )
        self._advantage = GAE(gamma=config.gamma, lmbda=config.gae_lambda, value_network=self._critic)
        self._loss = ClipPPOLoss(
            self._policy,
            self._critic,
            clip_epsilon=config.clip,
            entropy_coeff=config.entropy,
            critic_coeff=config.value_scale,
            normalize_advantage=False,  # over the round, not here: see `_learn`
        )
        self._parameters = [*self.actor.parameters(), *self._critic.parameters()]
        self._optimizer = torch.optim.Adam(self._parameters, lr=config.learning_rate)
        self._schedule = torch.optim.lr_scheduler.ExponentialLR(self._optimizer, config.learning_rate_decay)
        self.updates, self.rounds = 0, 0

    def round(self) -> dict[str, Number]:
        """Drives `horizon` steps everywhere, and learns from them.

        Returns:
            A row of metrics.csv.
        """
        share = self._config.guided_share_at(self.rounds)
        self._environments.guided_share = share
        batch, finished, guided_steps = self._collect()
        row: dict[str, Number] = {"guided_share": share, "learning_rate": float(self._schedule.get_last_lr()[0])}
        mean = float(batch["next", "reward"].mean())
        row |= _outcome(finished) | {"guided_steps": guided_steps, "reward": mean / self._config.reward_scale}
        row |= self._learn(batch)
        self._schedule.step()
        self.rounds += 1
        self._look_back(batch["observation"].flatten(0, 1))
        std = float(self.actor.log_std.detach().exp().mean())
        return row | {"std": std, "updates": self.updates, "episodes": self._environments.finished_count}

    def begin(self) -> None:
        """Begins the first episodes, after the imitation of the expert if that is set."""
        if self._config.imitated_steps:
            self._environments.guided_share = 1.0
            self._environments.begin()
            self._imitate()
        self._environments.guided_share = self._config.guided_share_at(0)
        self._environments.begin()

    def _imitate(self) -> None:
        config = self._config
        imitation = Imitation(self.actor, self._value, self._environments, config.gamma, config.reward_scale)
        imitation.learn(config.imitated_steps, self._look_back)

    def _look_back(self, seen: torch.Tensor) -> None:
        """Updates the normalisation with (B, O) observations."""
        if self._config.normalised:
            self._moments.add(seen)
            self.actor.normalise(self._moments.mean, self._moments.scale)

    def act(self, observation: Array) -> Array:
        """One observation -> one action, without exploration."""
        return self.actor.act(observation)

    def state(self) -> dict[str, Any]:
        """State for a checkpoint."""
        return {
            "actor": self.actor.state_dict(),
            "critic": self._critic.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "schedule": self._schedule.state_dict(),
            "updates": self.updates,
            "rounds": self.rounds,
            "moments": self._moments.state(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state."""
        self.actor.load_state_dict(state["actor"])
        self._critic.load_state_dict(state["critic"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._schedule.load_state_dict(state["schedule"])
        self.updates, self.rounds = state["updates"], state["rounds"]
        self._moments.restore(state["moments"])

    def _collect(self) -> tuple[TensorDict, list[Finished], int]:
        """A round: (N, T) transitions with advantages, finished episodes, and the number of the expert's steps."""
        observations, units, transitions, guided = [], [], [], 0
        for _ in range(self._config.horizon):
            observations.append(self._tensor(self._environments.observation.copy()))
            with torch.no_grad():
                unit = torch.normal(*self.actor.gaussian(observations[-1]))
            for rank, expert in enumerate(self._environments.expert):
                if expert is not None:
                    unit[rank] = self.actor.unscaled(self._tensor(expert))
                    guided += 1
            units.append(unit)
            with torch.no_grad():
                transitions.append(self._environments.step(self.actor.scaled(unit).cpu().numpy()))
        size = [len(self._environments), self._config.horizon]
        batch = TensorDict(
            {
                "observation": torch.stack(observations, dim=1),
                "action": torch.stack(units, dim=1),
                "next": self._after(transitions, size),
            },
            size,
            device=self._device,
        )
        with torch.no_grad():
            # Density of the executed action, chosen by policy or expert: GPPO's "as if on-policy".
            batch["action_log_prob"] = self._policy.get_dist(batch).log_prob(batch["action"])
            self._advantage(batch)
        return batch, [episode for transition in transitions for episode in transition.finished], guided

    def _after(self, transitions: Sequence[Transition], size: list[int]) -> TensorDict:
        """TorchRL's entries under "next"."""

        def stacked(rows: Iterable[Array]) -> torch.Tensor:
            return torch.from_numpy(np.stack(list(rows), axis=1)).to(self._device)

        rewards = stacked(transition.reward for transition in transitions)
        terminated = stacked(transition.terminated for transition in transitions)[..., None]
        truncated = stacked(transition.truncated for transition in transitions)[..., None]
        return TensorDict(
            {
                "observation": stacked(transition.observation for transition in transitions),
                "reward": rewards[..., None] * self._config.reward_scale,
                "terminated": terminated,
                "done": terminated | truncated,
            },
            size,
        )

    def _learn(self, batch: TensorDict) -> dict[str, Number]:
        """Several epochs over a round; means of the losses, and the variance that the critic explained."""
        data, sums = batch.reshape(-1), defaultdict[str, float](float)
        # Rare infractions are in few rows; in a batch without one, normalised noise would count as much.
        if len(data) > 1:  # a single one has no variance
            advantage = data["advantage"]
            data["advantage"] = (advantage - advantage.mean()) / advantage.std().clamp(min=1e-6)
        row: dict[str, Number] = {"explained_variance": _explained(data["state_value"], data["value_target"])}
        before = self.updates
        for _ in range(self._config.epochs):
            for rows in torch.split(torch.randperm(len(data)), self._config.batch):
                losses = self._loss(data[rows.to(self._device)])
                total = losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]
                self._optimizer.zero_grad(set_to_none=True)
                total.backward()
                nn.utils.clip_grad_norm_(self._parameters, self._config.gradient_norm)
                self._optimizer.step()
                self.updates += 1
                for name in LOSSES:
                    sums[name] += losses[name].item()
        return row | {name: value / (self.updates - before) for name, value in sums.items()}

    def _tensor(self, array: Array) -> torch.Tensor:
        return torch.as_tensor(array, dtype=torch.float32, device=self._device)


def _outcome(finished: Sequence[Finished]) -> dict[str, Number]:
    """Results of the episodes of a round, separately for policy and expert."""
    own = [episode for episode in finished if not episode.guided]
    guided = [episode for episode in finished if episode.guided]
    return {
        "return": _mean([episode.total for episode in own]),
        "length": _mean([episode.length for episode in own]),
        "success": _mean([100.0 * episode.success for episode in own]),
        "guided_episodes": len(guided),
        "guided_return": _mean([episode.total for episode in guided]),
    }


def _mean(values: Sequence[float]) -> float | None:
    return math.fsum(values) / len(values) if values else None


def _explained(value: torch.Tensor, target: torch.Tensor) -> float | None:
    """Share of the targets' variance that the values explain; None where there is none."""
    variance = float(target.var())
    return 1.0 - float((target - value).var()) / variance if np.isfinite(variance) and variance > 1e-12 else None
