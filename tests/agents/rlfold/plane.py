"""A point on a plane with an expert, learned by RLfOLD: what a resumption needs of a task, without a simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from dohyo.agents.learning.algorithms.off_policy import make_replay
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.runs.config import RunConfig
from dohyo.agents.learning.runs.run import TaskRun
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.learning.runs.training import train_task
from dohyo.agents.learning.tasks.task import Array, Env, Task, held_out_seeds
from dohyo.agents.rlfold.rlfold import EXTRAS, Rlfold, RlfoldConfig

LENGTH = 20


@dataclass(frozen=True)
class Plane(Task):
    """The reward is minus the distance from 0; the expert goes there."""

    name = "plane"
    observation_space = Box(-np.inf, np.inf, (2,), np.float32)
    action_space = Box(-1.0, 1.0, (2,), np.float32)
    has_expert = True

    @property
    def held_out(self) -> Sequence[int]:
        """See `Task`."""
        return held_out_seeds(3)

    def make_env(self, rank: int) -> Env:
        """See `Task`."""
        return _PlaneEnv()


class _PlaneEnv(gymnasium.Env[Array, Array]):
    observation_space, action_space = Plane.observation_space, Plane.action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        self._place = np.random.default_rng(seed).uniform(-1.0, 1.0, 2).astype(np.float32)
        self._steps = 0
        return self._place, {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        self._place = (self._place + 0.2 * action).astype(np.float32)
        self._steps += 1
        return self._place, -float(np.hypot(*self._place)), False, self._steps == LENGTH, {}

    def expert_action(self) -> Array:
        return np.clip(-5.0 * self._place, -1.0, 1.0)


class PlaneConfig(RunConfig):
    """Small numbers, a checkpoint every other round."""

    steps: int = 600
    processes: int = 0
    checkpoint_every: int = 100
    evaluate_every: int = 300
    tensorboard: bool = False
    device: str = "cpu"
    rlfold: RlfoldConfig = RlfoldConfig(batch=16, hidden=(16,), learning_starts=100, round_steps=50)


def _train(settings: PlaneConfig, request: TrainRequest) -> Path:
    def make(collector: Collector, run: TaskRun) -> Rlfold:
        replay = make_replay(Plane(), run, settings.rlfold, rows=len(collector), extras=EXTRAS)
        return Rlfold(Plane(), collector, replay, settings.rlfold, run.device)

    return train_task(make, Plane(), settings, request)


PLANE = Trainer("a point on a plane, by RLfOLD", PlaneConfig, _train)
