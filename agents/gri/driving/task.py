"""DrivingTask: missions in town by GRIAD's choices and reward, with the autopilot as expert.

An episode is terminated by what the reward punishes, see `reward`. It is truncated at its goal, as at the end of its
time: the thesis's drives have no goal, and a state without future there would teach not to reach it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import gymnasium
import numpy as np
from gymnasium.spaces import Dict, Discrete

from dohyo.agents.experts.autopilot import Autopilot
from dohyo.agents.gri.driving.affordances import Affordances, Classification, Untrained
from dohyo.agents.gri.driving.choices import CONTROL, TABLE, nearest
from dohyo.agents.gri.driving.missions import draw_mission, draw_varied
from dohyo.agents.gri.driving.pictures import Pictures
from dohyo.agents.gri.driving.reward import End, GriadReward
from dohyo.agents.gri.driving.state import DrivingState
from dohyo.agents.gri.driving.target_speed import target_speed
from dohyo.agents.learning.policies.policy_agent import SensorEncoder
from dohyo.agents.learning.tasks.task import Array, Env, Task
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.seeds import HELD_OUT_FROM

EGO: Final = "ego"
REPEAT: Final = 2
"""Ticks of 0.1 s that a choice is driven for."""
VARIED: Final = "-varied"
"""End of the name of a task under several conditions."""
Sight = Literal["state", "pictures", "affordances", "classification", "untrained"]
ENCODERS: Final[Mapping[Sight, type[SensorEncoder]]] = {
    "state": DrivingState,
    "pictures": Pictures,
    "affordances": Affordances,
    "classification": Classification,
    "untrained": Untrained,
}


@dataclass(frozen=True)
class DrivingTask(Task):
    """Missions from seeds.

    Attributes:
        sees: What the driver sees.
        episodes: Number of held-out episodes.
        first: Seed of the first of them.
        repeat: Ticks of a choice; rewards are means over them, so that the highest stays 1.
        varied: Missions have NoCrash's four conditions of training in turn. What has learned from pictures of clear
            days alone stands in rain.
    """

    sees: Sight = "state"
    episodes: int = 20
    first: int = HELD_OUT_FROM
    repeat: int = REPEAT
    varied: bool = False

    measures = ("completed", *(end.value for end in End))
    has_expert = True
    alone = True

    @property
    def name(self) -> str:
        """See `Task`."""
        return f"driving-{self.sees}{VARIED if self.varied else ''}"

    @property
    def observation_space(self) -> Dict:
        """See `Task`."""
        return ENCODERS[self.sees].space

    @property
    def action_space(self) -> Discrete:
        """See `Task`."""
        return Discrete(len(TABLE))

    @property
    def held_out(self) -> Sequence[int]:
        """See `Task`."""
        return range(self.first, self.first + self.episodes)

    def make_env(self, rank: int) -> Env:
        """See `Task`."""
        return MissionEnv(self)


class MissionEnv(gymnasium.Env[dict[str, Array], Any]):
    """See `DrivingTask`."""

    def __init__(self, task: DrivingTask) -> None:
        """Compiles the kernels; the simulation starts at `reset`."""
        self.observation_space: Any = task.observation_space
        self.action_space = task.action_space
        self._sight, self._repeat = ENCODERS[task.sees](), task.repeat
        self._draw = draw_varied if task.varied else draw_mission
        self._expert = Autopilot()  # type: ignore[abstract]
        self._sight.warm_up()
        self._driving: DrivingEnv | None = None
        self._advised = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Begins the mission of a seed."""
        self.close()
        sensors = dict.fromkeys((*self._sight.sensors, *Autopilot.spec.sensors))
        scenario = self._draw(seed or 0)
        self._driving = DrivingEnv(scenario, tuple(sensors), CONTROL, reward=None)
        observations, _ = self._driving.reset()
        self._seen: Observation = observations[EGO]
        self._reward, self._advised = GriadReward(), False
        self._sight.reset(scenario.missions[0], scenario.seed)
        return self._sight.encode(self._seen), {}

    def step(self, action: Any) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        """Drives a choice for some ticks; the reward is their mean.

        Raises:
            SimulationError: It has not been reset, or SUMO failed.
        """
        if self._driving is None:
            raise SimulationError("the environment has not been reset")
        rewards, end, info, over = [], None, {}, False
        for _ in range(self._repeat):
            before = self._driving.world
            observations, _, reached, late, infos = self._driving.step({EGO: TABLE[int(action)]})
            self._seen = observations[EGO]
            encoded = self._sight.encode(self._seen)  # in every tick: it may remember the last ones
            reward, end = self._reward.tick(before, self._driving.world, target_speed(self._seen))
            rewards.append(reward)
            over = reached[EGO] or late[EGO]
            if end is not None or over:
                info = self._measures(end, end is None and bool(infos[EGO].get("success", False)))
                break
        value = float(np.mean(rewards)) if end is None else rewards[-1]
        return encoded, value, end is not None, over and end is None, info

    def expert_action(self) -> int:
        """The autopilot's choice; must be asked for at every step of an episode, or at none."""
        assert self._driving is not None
        if not self._advised:
            scenario = self._driving.scenario
            self._expert.reset(scenario.missions[0], scenario.seed)
            self._advised = True
        return nearest(self._expert.act(self._seen))

    def close(self) -> None:
        """Ends the simulation."""
        if self._driving is not None:
            self._driving.close()
            self._driving = None

    def _measures(self, end: End | None, success: bool) -> dict[str, Any]:
        """Measures of an episode that has ended."""
        assert self._driving is not None
        world = self._driving.world
        share = 100.0 * float(world.egos.progress[0]) / world.routes[0].length
        told = {str(kind): float(end is kind) for kind in End}
        return {"success": success, "completed": 100.0 if success else min(share, 100.0), **told}
