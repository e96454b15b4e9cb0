"""Imitation of the task's expert by policy and critic, before the first round of PPO.

DAgger (Ross et al. 2011): expert rollouts first, then expert labels on policy rollouts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor, nn

from dohyo.agents.learning.behaviour import DEMONSTRATOR, POLICY
from dohyo.agents.learning.collector import Collector
from dohyo.agents.learning.policy import Actor, joined
from dohyo.agents.learning.task import Array
from dohyo.sumo_networks.arrays import BoolArray, IntArray

PARTS = 6
PASSES, LAST_PASSES = 10, 30
BATCH, LEARNING_RATE, LAST_LEARNING_RATE = 128, 1e-3, 2e-4
WEIGHT_DECAY = 0.3
"""Weight decay against overfitting: there are many ticks, but few episodes."""


@dataclass(slots=True)
class Lessons:
    """Demonstrations so far, one row per step and environment.

    Attributes:
        seen: (O,) observation of each.
        answers: (A,) expert's action of each, in [-1, 1].
        returns: Discounted rewards to the end of the episode or of the part.
    """

    seen: list[Array] = field(default_factory=list)
    answers: list[Tensor] = field(default_factory=list)
    returns: list[float] = field(default_factory=list)


class Imitation:
    """Fits an actor and a critic to an expert."""

    def __init__(self, actor: Actor, critic: nn.Module, collector: Collector, gamma: float, scale: float) -> None:
        """Prepares the imitation.

        Args:
            actor: Its mean is fitted to the expert.
            critic: (B, O) -> (B, 1), fitted to the discounted returns.
            collector: Of the training; its expert is asked at every step.
            gamma: Discount per step.
            scale: Of the rewards.
        """
        self._actor, self._critic, self._collector = actor, critic, collector
        self._gamma, self._scale = gamma, scale
        self._lessons = Lessons()
        self._optimizer = torch.optim.AdamW([*actor.body.parameters(), *critic.parameters()], weight_decay=WEIGHT_DECAY)

    def learn(self, steps: int, look: Callable[[Tensor], None]) -> None:
        """Collects demonstrations and learns from them.

        Args:
            steps: Of all environments together.
            look: Called with the (B, O) observations of each part, before they are learned.
        """
        ticks = max(steps // (PARTS * len(self._collector)), 1)
        for part in range(PARTS):
            before = len(self._lessons.seen)
            self._collect(ticks, follow=part == 0)
            if new := self._lessons.seen[before:]:
                look(self._tensor(np.stack(new)))
                self._fit(PASSES, LEARNING_RATE)
        if self._lessons.seen:
            self._fit(LAST_PASSES, LAST_LEARNING_RATE)

    def _collect(self, ticks: int, follow: bool) -> None:
        """Drives as the expert or as the actor does, in both cases with the actor's noise."""
        driver = _Noisy(self._actor, follow)
        steps = TensorDict.stack([self._collector.step(driver) for _ in range(ticks)], dim=1)
        self._collector.finished()
        ended, rewards = steps["next", "done"][..., 0], steps["next", "reward"][..., 0] * self._scale
        returns = self._returns(rewards.numpy().astype(np.float64), ended.numpy())
        asked = steps["answered"].numpy()
        seen = joined(steps["observation"])
        for tick in range(ticks):
            for row in np.flatnonzero(asked[:, tick]).tolist():
                self._lessons.seen.append(seen[row, tick].numpy())
                self._lessons.answers.append(steps["answer"][row, tick])
                self._lessons.returns.append(float(returns[row, tick]))

    def _returns(self, rewards: Array, ended: Array) -> Array:
        """(N, T) discounted future rewards; the critic gives the value after the last tick."""
        with torch.no_grad():
            after = self._critic(joined(self._collector.seen).to(self._actor.low.device))[:, 0]
        value = after.cpu().numpy().astype(np.float64)
        returns = np.zeros_like(rewards)
        for tick in reversed(range(rewards.shape[1])):
            value = rewards[:, tick] + self._gamma * np.where(ended[:, tick], 0.0, value)
            returns[:, tick] = value
        return returns

    def _fit(self, passes: int, rate: float) -> None:
        lessons = self._lessons
        self._optimizer.param_groups[0]["lr"] = rate
        seen = self._tensor(np.stack(lessons.seen))
        answers, returns = torch.stack(lessons.answers).to(seen.device), self._tensor(np.array(lessons.returns))
        for _ in range(passes):
            for rows in torch.split(torch.randperm(len(seen)).to(seen.device), BATCH):
                mean, value = self._actor.gaussian(seen[rows])[0], self._critic(seen[rows])[:, 0]
                loss = nn.functional.smooth_l1_loss(mean, answers[rows], beta=0.1)
                loss = loss + 0.1 * nn.functional.smooth_l1_loss(value, returns[rows])
                self._optimizer.zero_grad(set_to_none=True)
                loss.backward()  # type: ignore[no-untyped-call]
                self._optimizer.step()

    def _tensor(self, array: Array) -> Tensor:
        return torch.as_tensor(array, dtype=torch.float32, device=self._actor.low.device)


class _Noisy:
    """Behaviour that drives as the expert, or as the actor, with the actor's noise, and keeps the expert's answers."""

    def __init__(self, actor: Actor, follow: bool) -> None:
        self._actor, self._follow = actor, follow

    def begin(self, rows: BoolArray, episodes: IntArray) -> None:
        """See `Behaviour`."""

    def asked(self, count: int) -> BoolArray:
        """See `Behaviour`."""
        return np.ones(count, np.bool_)

    def act(self, observation: TensorDict, label: Tensor, labelled: Tensor) -> TensorDict:
        """See `Behaviour`; adds the expert's "answer" (N, A) in [-1, 1], and whether it "answered"."""
        device = self._actor.low.device
        with torch.no_grad():
            mean, std = self._actor.gaussian(joined(observation).to(device))
            answers = torch.where(labelled.to(device)[:, None], self._actor.unscaled(label.to(device)), mean)
            action = self._actor.scaled(torch.normal(answers if self._follow else mean, std))
        source = torch.full(observation.batch_size, DEMONSTRATOR if self._follow else POLICY, dtype=torch.uint8)
        kept = {"action": action.cpu(), "source": source, "answer": answers.cpu(), "answered": labelled}
        return TensorDict(kept, observation.batch_size)
