"""Imitation of the task's expert by policy and critic, before the first round of PPO.

DAgger (Ross et al. 2011): expert rollouts first, then expert labels on policy rollouts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor, nn

from dohyo.agents.learning.environments import Environments
from dohyo.agents.learning.policy import Actor
from dohyo.agents.learning.task import Array

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

    def __init__(self, actor: Actor, critic: nn.Module, environments: Environments, gamma: float, scale: float) -> None:
        """Prepares the imitation.

        Args:
            actor: Its mean is fitted to the expert.
            critic: (B, O) -> (B, 1), fitted to the discounted returns.
            environments: Of the training; all of their episodes must be guided while this runs.
            gamma: Discount per step.
            scale: Of the rewards.
        """
        self._actor, self._critic, self._environments = actor, critic, environments
        self._gamma, self._scale = gamma, scale
        self._lessons = Lessons()
        self._optimizer = torch.optim.AdamW([*actor.body.parameters(), *critic.parameters()], weight_decay=WEIGHT_DECAY)

    def learn(self, steps: int, look: Callable[[Tensor], None]) -> None:
        """Collects demonstrations and learns from them.

        Args:
            steps: Of all environments together.
            look: Called with the (B, O) observations of each part, before they are learned.
        """
        ticks = max(steps // (PARTS * len(self._environments)), 1)
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
        environments, count = self._environments, len(self._environments)
        rewards, ends, asked = np.zeros((ticks, count)), np.zeros((ticks, count), np.bool_), []
        for tick in range(ticks):
            seen = environments.observation.copy()
            with torch.no_grad():
                mean, std = self._actor.gaussian(self._tensor(seen))
            answers = mean.clone()
            for rank, expert in enumerate(environments.expert):
                if expert is not None:
                    answers[rank] = self._actor.unscaled(self._tensor(expert))
                    asked.append((tick, rank, seen[rank], answers[rank].cpu()))
            driven = torch.normal(answers if follow else mean, std)
            transition = environments.step(self._actor.scaled(driven).cpu().numpy())
            rewards[tick], ends[tick] = transition.reward, transition.terminated | transition.truncated
        returns = self._returns(rewards * self._scale, ends)
        for tick, rank, row, answer in asked:
            self._lessons.seen.append(row)
            self._lessons.answers.append(answer)
            self._lessons.returns.append(float(returns[tick, rank]))

    def _returns(self, rewards: Array, ends: Array) -> Array:
        """(T, N) discounted future rewards; the critic gives the value after the last tick."""
        with torch.no_grad():
            after = self._critic(self._tensor(self._environments.observation))[:, 0].cpu().numpy().astype(np.float64)
        returns = np.zeros_like(rewards)
        for tick in reversed(range(len(rewards))):
            after = rewards[tick] + self._gamma * np.where(ends[tick], 0.0, after)
            returns[tick] = after
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
