"""Pictures drawn at random instead of a town, learned by RLAD and its rivals: a training without a simulation."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Dict

from dohyo.agents.endless_driving.environment import LIGHT
from dohyo.agents.endless_driving.observation import PICTURE
from dohyo.agents.endless_driving.task import EndlessDriving
from dohyo.agents.learning.experience.replay import ReplayConfig
from dohyo.agents.learning.runs.trainer import Trainer
from dohyo.agents.learning.tasks.environments import FrameStack
from dohyo.agents.learning.tasks.task import Array, Env, Environments, Task, held_out_seeds
from dohyo.agents.rlad.rivals.drq_v2 import DrqV2Config
from dohyo.agents.rlad.training import RLAD, RladConfig, RladRunConfig

LENGTH = 8
SMALL: dict[str, Any] = {"hidden": (16,), "batch": 4, "learning_starts": 8, "round_steps": 5, "updates_per_step": 0.25}


class DrawnTown(EndlessDriving):
    """Spaces of the town; every frame is drawn anew, and the reward is minus the size of the action."""

    alone, measures = False, ()

    @property
    def held_out(self) -> Sequence[int]:
        """See `Task`."""
        return held_out_seeds(1)

    def make_environments(self, count: int, processes: bool) -> Environments:
        """See `Task`; pictures are stacked."""
        return FrameStack(Task.make_environments(_SingleFrames(self.town), count, processes), self.town.frames)


class _SingleFrames(DrawnTown):
    @cached_property
    def observation_space(self) -> Dict:
        return self.single_space

    def make_env(self, rank: int) -> Env:
        return _DrawnEnv(self)


class _DrawnEnv(gymnasium.Env[Any, Array]):
    def __init__(self, task: DrawnTown) -> None:
        self.observation_space, self.action_space = task.observation_space, task.action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        self._random, self._steps = np.random.default_rng(seed), 0
        return self._seen(), {}

    def step(self, action: Array) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self._steps += 1
        return self._seen(), -float(np.hypot(*action)), False, self._steps == LENGTH, {}

    def _seen(self) -> dict[str, Array]:
        light = self._random.integers(3, size=1).astype(np.float32)
        seen: dict[str, Array] = {}
        for name, box in self.observation_space.spaces.items():
            drawn = self._random.integers(256, size=box.shape, dtype=np.uint8)
            seen[name] = drawn if name == PICTURE else light if name == LIGHT else drawn.astype(np.float32) / 256
        return seen


class DrawnConfig(RladRunConfig):
    """Small numbers; the ring of the replay is filled more than once."""

    steps: int = 120
    processes: int = 0
    environments: int = 2
    evaluate_every: int = 120
    checkpoint_every: int = 20
    tensorboard: bool = False
    device: str = "cpu"
    sac: RladConfig = RladConfig(**SMALL, replay=ReplayConfig(capacity=24))
    drq_v2: DrqV2Config = DrqV2Config(**SMALL, replay=ReplayConfig(capacity=24, steps=3))

    @property
    def task(self) -> DrawnTown:
        """See `RladRunConfig`."""
        return DrawnTown(self.town)


DRAWN = Trainer("pictures drawn at random, by RLAD or a rival", DrawnConfig, RLAD.train)
