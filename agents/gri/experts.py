"""Experts whose demonstrations are recorded: a trained policy or the task's own, and how many are bad.

A bad demonstration is an episode of random actions. Chekroun 2024 keeps about 10 % of bad ones on purpose.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete
from gymnasium.vector import VectorWrapper

from dohyo.agents.learning.files.card import CARDS, read_cards
from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.learning.tasks.environments import Reset, Step
from dohyo.agents.learning.tasks.task import Array, Environments, Task, named
from dohyo.sumo_networks.arrays import BoolArray
from dohyo.sumo_networks.errors import InvalidInputError

_BAD = 3  # separates this random stream from the others of a seed


@dataclass(frozen=True)
class DemonstratedTask(Task):
    """A task whose episodes an expert demonstrates.

    Attributes:
        task: What is demonstrated.
        policy: ONNX file of the expert; None: the task's own expert.
        noise: Share of episodes with random actions, which are spread evenly over all.
    """

    task: Task
    policy: Path | None = None
    noise: float = 0.0

    has_expert = True

    @property
    def name(self) -> str:
        """See `Task`."""
        return self.task.name

    @property
    def observation_space(self) -> Box | Dict:
        """See `Task`."""
        return self.task.observation_space

    @property
    def action_space(self) -> Box | Discrete:
        """See `Task`."""
        return self.task.action_space

    @property
    def held_out(self) -> Sequence[int]:
        """See `Task`."""
        return self.task.held_out

    @property
    def measures(self) -> tuple[str, ...]:
        """See `Task`."""
        return self.task.measures

    @property
    def alone(self) -> bool:
        """See `Task`."""
        return self.task.alone

    def make_environments(self, count: int, processes: bool) -> Environments:
        """See `Task`.

        Raises:
            InvalidInputError: The policy is missing or is one of other observations, or there is no expert at all.
        """
        policy = None
        if self.policy is not None:
            policy = expert_policy(self.policy, self.task)
        elif not self.task.has_expert:
            raise InvalidInputError(f"task '{self.name}' has no expert: expected a policy that demonstrates it")
        return _WithExpert(self.task.make_environments(count, processes), policy, self.noise)


def expert_policy(path: Path, task: Task) -> OnnxPolicy:
    """A trained policy as the expert of a task.

    Raises:
        InvalidInputError: The file is missing, or a policy of another task, as its spaces or the card beside it say.
    """
    policy = OnnxPolicy(path)
    policy.check(named(task.observation_space))
    policy.check_actions(task.action_space)
    cards = read_cards(path.parent) if (path.parent / CARDS).exists() else {}
    for card in cards.values():
        if path.name in card.files and card.subject != task.name:
            raise InvalidInputError(f"'{path}': expected a policy of '{task.name}', its card says '{card.subject}'")
    return policy


class _WithExpert(VectorWrapper):
    """Environments with the expert of a `DemonstratedTask`."""

    def __init__(self, environments: Environments, policy: OnnxPolicy | None, noise: float) -> None:
        super().__init__(environments)
        self._policy, self._noise, self._begun = policy, noise, 0
        self._seen: dict[str, Array] = {}
        self._bad: dict[int, np.random.Generator] = {}  # by row, of its present episode

    def __getattr__(self, name: str) -> Any:
        """What the environments offer beside gymnasium's methods; steps are not asynchronous."""
        if name.startswith("_") or name in ("step_async", "step_wait"):
            raise AttributeError(name)
        return getattr(self.env, name)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> Reset:
        """See `VectorEnv`; the number of an episode decides whether it is bad."""
        for row, one in enumerate(seed):
            if one is not None:
                self._bad.pop(row, None)
                if self._next_is_bad():
                    self._bad[row] = np.random.default_rng([_BAD, one])
        self._seen, infos = self.env.reset(seed=seed, options=options)
        return self._seen, infos

    def _next_is_bad(self) -> bool:
        """Whether the share of bad episodes asks for one now."""
        self._begun += 1
        return math.floor(self._begun * self._noise + 0.5) > math.floor((self._begun - 1) * self._noise + 0.5)

    def step(self, actions: Array) -> Step:
        """See `VectorEnv`."""
        step: Step = self.env.step(actions)
        self._seen = step[0]
        return step

    def expert_actions(self, rows: BoolArray) -> tuple[Array, BoolArray]:
        """(N, ...) actions in (N,) rows, and (N,) whether there is one."""
        if self._policy is None:
            actions, known = self.env.expert_actions(rows)  # type: ignore[attr-defined]
        else:
            actions, known = self._policy.of_batch(self._seen), rows.copy()
        for row, generator in self._bad.items():
            if rows[row]:
                actions[row], known[row] = _drawn(self.single_action_space, generator), True
        return actions, known


def _drawn(space: Any, generator: np.random.Generator) -> Any:
    if isinstance(space, Discrete):
        return generator.integers(int(space.n))
    return generator.uniform(space.low, space.high)
