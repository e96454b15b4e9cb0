"""Small environments, found by pickle in worker processes."""

from __future__ import annotations

import os
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete

from dohyo.sumo_networks.errors import SimulationError

LENGTH = 20


class Point(gymnasium.Env[Any, Any]):
    """A point on a line; the reward is minus its distance from 0. It starts at the side that the seed says.

    Attributes:
        fragile: How it fails, if at all: "nan", "shape", "dtype", "reward", "rewards", "word", "success", "measure",
            "raise", "close"; and on the right side only, "die" (its process does, at the third step), "crash" (its
            simulation does) and "crash-at-reset". With "boxed" its reward is an array of one number, and it works.
    """

    observation_space = Box(-np.inf, np.inf, (2,), np.float32)
    action_space = Box(-0.25, 0.25, (1,), np.float32)

    def __init__(self, fragile: str = "", rank: int = 0) -> None:
        self.fragile, self.rank = fragile, rank
        self.begun, self.place, self.time, self.level = 0.0, 0.0, 0, 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        self.begun = self.place = float(np.random.default_rng(seed).choice([-1.0, 1.0]))
        self.time, self.level = 0, (options or {}).get("level", 0)
        if self.fragile == "crash-at-reset" and self.begun > 0:
            raise SimulationError("the point has no line")
        return self.observation(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.place += float(action[0])
        self.time += 1
        if self.fragile == "raise":
            raise ValueError("the point is lost")
        if self.begun > 0 and self.time == 3:
            if self.fragile == "die":
                raise SystemExit(3)
            if self.fragile == "crash":
                raise SimulationError("the point fell off the line")
        success = "no" if self.fragile == "success" else abs(self.place) < 0.25
        info: dict[str, Any] = {"success": success} | ({} if self.fragile == "measure" else {"distance": self.place})
        distance = abs(self.place)
        odd = {"reward": np.inf, "rewards": np.zeros(2), "word": "1", "boxed": np.array([-distance])}
        reward: Any = odd.get(self.fragile, -distance)
        return self.observation(), reward, False, self.time == LENGTH + self.level, info

    def close(self) -> None:
        if self.fragile == "close":
            raise ValueError("the point stays")

    def observation(self) -> Any:
        place = np.nan if self.fragile == "nan" and self.time else self.place
        seen = np.array([place, self.time], np.complex64 if self.fragile == "dtype" and self.time else np.float32)
        return seen[None] if self.fragile == "shape" and self.time else seen

    def expert_action(self) -> Any:
        return None if self.time > 10 else np.array([np.clip(-self.place, -0.25, 0.25)], np.float32)

    def render(self) -> Any:
        return np.full((2, 2, 3), self.time, np.uint8)


class Counter(gymnasium.Env[Any, Any]):
    """Counts its actions, and shows the count, its threads and whether its process leads a group."""

    observation_space = Dict({"picture": Box(0, 255, (3, 4, 5), np.uint8), "vector": Box(-1e9, 1e9, (3,), np.float32)})
    action_space = Discrete(3)

    def __init__(self, rank: int) -> None:
        self.rank, self.count = rank, 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        self.count = seed or 0
        return self.observation(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        assert type(action) is int
        self.count += action
        return self.observation(), 1.0, self.count >= 10, False, {}

    def observation(self) -> Any:
        threads = int(os.environ.get("OMP_NUM_THREADS", 0))
        vector = np.array([self.rank, threads, os.getpgrp() == os.getpid()], np.float32)
        return {"picture": np.full((3, 4, 5), self.count, np.uint8), "vector": vector}


class Pair:
    """Two agents, in PettingZoo's form: the first leaves after two steps, the second after four.

    Attributes:
        breach: Of PettingZoo's rules: "late" (the second is not there at the reset), "lost" (the first leaves without
            an end), "stays" (the first is still among the agents after its end).
    """

    possible_agents = ("short", "long")
    observation_space = Box(-np.inf, np.inf, (1,), np.float32)
    action_space = Box(-1, 1, (1,), np.float32)

    def __init__(self, rank: int, breach: str = "") -> None:
        self.agents: list[str] = []
        self.breach = breach

    def reset(self, seed: int | None, options: dict[str, Any] | None) -> tuple[dict[str, Any], dict[str, Any]]:
        self.agents, self.time, self.seed = list(self.possible_agents), 0, seed
        if self.breach == "late":
            self.agents = ["short"]
        return self.observations(), {}

    def step(self, actions: dict[str, Any]) -> tuple[dict[str, Any], ...]:
        assert list(actions) == self.agents
        self.time += 1
        ends = {agent: self.time == (2 if agent == "short" else 4) for agent in self.agents}
        infos = {agent: {"success": agent == "long", "way": float(actions[agent][0])} for agent in self.agents}
        never = dict.fromkeys(self.agents, False)
        result = self.observations(), dict.fromkeys(self.agents, 1.0), ends, never, infos
        if self.breach == "lost":
            ends["short"], self.agents = False, ["long"]
        elif self.breach != "stays" or self.time == 4:
            self.agents = [agent for agent in self.agents if not ends[agent]]
        return result

    def observations(self) -> dict[str, Any]:
        return {agent: np.float32([self.seed + self.time / 10]) for agent in self.agents}

    def close(self) -> None:
        pass
