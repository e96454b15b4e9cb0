"""Small things to learn. Without torch, since the processes of environments import this."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete

from dohyo.agents.learning.tasks.task import Array, Env, Task, held_out_seeds
from dohyo.sumo_networks.errors import SimulationError

Step = tuple[Array, float, bool, bool, dict[str, Any]]

STEP, LENGTH = 0.25, 20
BEST_RETURN = -1.5
"""Of a point: from 1 or -1 it is 0.75, 0.5 and 0.25 away, then there."""


@dataclass(frozen=True)
class Point(Task):
    """A point on a line that has to come to rest at 0; the reward is minus its distance.

    Attributes:
        slow_s: What a step takes beside.
        reticent: Whether its expert has no opinion on the right side.
        fragile: How it fails, if at all: "nan", "raise", "drift" (it is not deterministic); and on the right side only,
            "die" (its process does, at once) and "crash" (its simulation does, at the third step).
    """

    slow_s: float = 0.0
    fragile: str = ""
    reticent: bool = False

    name = "point"
    observation_space = Box(-np.inf, np.inf, (2,), np.float32)
    action_space = Box(np.array([-STEP], np.float32), np.array([STEP], np.float32))
    held_out: Sequence[int] = held_out_seeds(4)
    measures = ("distance",)

    has_expert = True

    def make_env(self, rank: int) -> Env:
        return PointEnv(self)


class PointEnv(gymnasium.Env[Array, Array]):
    """See `Point`."""

    def __init__(self, task: Point) -> None:
        self.task, self.begun, self.place, self.time = task, 0.0, 0.0, 0
        self.observation_space, self.action_space = task.observation_space, task.action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        self.begun, self.time = float(np.random.default_rng(seed).choice([-1.0, 1.0])), 0
        self.place = self.begun
        return self._observation(), {}

    def step(self, action: Array) -> Step:
        if self.task.slow_s:
            time.sleep(self.task.slow_s)
        self.place += float(action[0]) + (time.time() % 1.0 if self.task.fragile == "drift" else 0.0)
        self.time += 1
        if self.task.fragile == "raise":
            raise ValueError("the point is lost")
        if self.task.fragile == "die" and self.begun > 0:
            raise SystemExit(3)
        if self.task.fragile == "crash" and self.begun > 0 and self.time == 3:
            raise SimulationError("the point fell off the line")
        distance = abs(self.place)
        info = {"success": distance < STEP, "distance": distance}
        return self._observation(), -distance, False, self.time == LENGTH, info

    def expert_action(self) -> Array | None:
        if self.task.reticent and self.place >= 0:
            return None
        return np.array([np.clip(-self.place, -STEP, STEP)], np.float32)

    def _observation(self) -> Array:
        place = np.nan if self.task.fragile == "nan" and self.time else self.place
        return np.array([place, self.time / LENGTH], np.float32)


@dataclass(frozen=True)
class Lock(Task):
    """Six dials to be set in a row, each to what it shows; only the open lock is rewarded, and one mistake ends it."""

    name = "lock"
    observation_space = Box(-1, 1, (2,), np.float32)
    action_space = Box(-1, 1, (1,), np.float32)
    held_out: Sequence[int] = held_out_seeds(10)

    has_expert = True

    def make_env(self, rank: int) -> Env:
        return LockEnv()


class LockEnv(gymnasium.Env[Array, Array]):
    """See `Lock`."""

    DIALS, TOLERANCE = 6, 0.3

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        self.targets, self.done = np.random.default_rng(seed).choice([-0.7, 0.7], self.DIALS + 1), 0
        return self.observation(), {}

    def step(self, action: Array) -> Step:
        right = abs(float(action[0]) - self.targets[self.done]) < self.TOLERANCE
        self.done += right
        opened = self.done == self.DIALS
        return self.observation(), float(opened), opened or not right, False, {"success": opened}

    def expert_action(self) -> Array | None:
        return self.observation()[:1]

    def observation(self) -> Array:
        return np.array([self.targets[self.done], self.done / self.DIALS], np.float32)


@dataclass(frozen=True)
class Sign(Task):
    """A picture with a bright side, and a number that says which side is right; ten signs are an episode."""

    name = "sign"
    observation_space = Dict({"camera": Box(0, 255, (1, 4, 4), np.uint8), "meaning": Box(-1, 1, (1,), np.float32)})
    action_space = Discrete(2)
    held_out: Sequence[int] = held_out_seeds(4)

    def make_env(self, rank: int) -> Env:
        return SignEnv()


class SignEnv(gymnasium.Env[Any, Any]):
    """See `Sign`."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        self._rng, self.time = np.random.default_rng(seed), 0
        return self._draw(), {}

    def step(self, action: Any) -> Any:
        right = int(action) == (self.side ^ self.reversed)
        self.time += 1
        return self._draw(), float(right), False, self.time == 10, {"success": right}

    def _draw(self) -> dict[str, Array]:
        self.side, self.reversed = (int(one) for one in self._rng.integers(2, size=2))
        picture = np.zeros((1, 4, 4), np.uint8)
        picture[:, :, 2 * self.side : 2 * self.side + 2] = 255
        return {"camera": picture, "meaning": np.array([2.0 * self.reversed - 1.0], np.float32)}


@dataclass(frozen=True)
class Dial(Task):
    """A dial of three positions, to be turned to a mark that is shown, ten times; each one is a tenth of the return."""

    name = "dial"
    observation_space = Box(0, 1, (3,), np.float32)
    action_space = Discrete(3)
    held_out: Sequence[int] = held_out_seeds(4)

    def make_env(self, rank: int) -> Env:
        return DialEnv()


class DialEnv(gymnasium.Env[Array, Any]):
    """See `Dial`."""

    LENGTH = 10
    observation_space, action_space = Dial.observation_space, Dial.action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        self.marks, self.time = np.random.default_rng(seed).integers(3, size=self.LENGTH + 1), 0
        return self._observation(), {}

    def step(self, action: Any) -> Step:
        right = int(action) == self.marks[self.time]
        self.time += 1
        return self._observation(), float(right) / self.LENGTH, self.time == self.LENGTH, False, {"success": right}

    def _observation(self) -> Array:
        return np.eye(3, dtype=np.float32)[self.marks[self.time]]


gymnasium.register("Point-v0", entry_point=lambda: PointEnv(Point()))
gymnasium.register("Dial-v0", entry_point=DialEnv)


class PictureEnv(gymnasium.Env[Array, Any]):
    """Always the same picture of 4 x 5 pixels: a hundred times the channel, ten times the column, and the row."""

    observation_space, action_space = Box(0, 255, (4, 5, 3), np.uint8), Discrete(2)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        row, column, channel = np.indices((4, 5, 3))
        return (row + 10 * column + 100 * channel).astype(np.uint8), {}


gymnasium.register("Picture-v0", entry_point=PictureEnv)
