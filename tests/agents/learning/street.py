"""A car among others on a straight road in SUMO, as a task. Without torch, as `problems`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from dohyo.agents.learning.tasks.task import Array, Env, Task, held_out_seeds
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from tests.worlds import straight_road

EGO = "ego"


@dataclass(frozen=True)
class Street(Task):
    """Drives on among eight cars, for 4 s."""

    name = "street"
    observation_space = Box(-np.inf, np.inf, (3,), np.float32)
    action_space = Box(np.array([-4.0, -0.1], np.float32), np.array([2.0, 0.1], np.float32))
    held_out: Sequence[int] = held_out_seeds(2)

    def make_env(self, rank: int) -> Env:
        return StreetEnv()


class StreetEnv(gymnasium.Env[Array, Array]):
    """See `Street`."""

    def __init__(self) -> None:
        mission = Mission(start=Place(lane="w_e_0", position_m=300.0), goal=Place(lane="w_e_0", position_m=-1.0))
        scenario = Scenario(
            network=str(straight_road().network.path),
            missions=(mission,),
            traffic=Traffic(vehicles=8, warm_up_s=2.0),
            time_limit_s=4.0,
        )
        self._env = DrivingEnv(scenario, ("speedometer",), "acceleration_steering", "progress")

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        self._env.reset(seed=seed)
        return self._observation(), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        _, rewards, terminations, truncations, _ = self._env.step({EGO: action})
        info = {"success": truncations[EGO]}
        return self._observation(), rewards[EGO], terminations[EGO], truncations[EGO], info

    def close(self) -> None:
        self._env.close()

    def _observation(self) -> Array:
        """Speed, distance from the centre, and how far the nearest other is: that tells one traffic from another."""
        egos, actors = self._env.world.egos, self._env.world.actors
        nearest = np.hypot(*(actors.position - egos.position[0]).T).min(initial=100.0)
        return np.array([egos.speed[0] / 10, egos.lateral[0], nearest / 100], np.float32)
