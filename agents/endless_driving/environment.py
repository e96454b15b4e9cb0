"""EndlessDrivingEnv: one ego in town; every decision holds for two ticks.

An episode is terminated by a collision, a red light that is run, 3.5 m beside the route, or a stand of 20 s on a free
road; it is truncated at the end of its time, or at its goal, whose success counts. Source of the reward: Roach.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import gymnasium
import numpy as np

from dohyo.agents.endless_driving.experts import Expert, label, make_expert
from dohyo.agents.endless_driving.observation import ACTION_REPEAT, TargetSpeed, make_view
from dohyo.agents.endless_driving.scenarios import draw_scenario
from dohyo.agents.learning.tasks.task import Array
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.envs.reward import LIGHT_M, RoachReward
from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.rules.contacts import is_touched
from dohyo.sumo_networks.rules.red_signal import CLOSED, next_signal, passed_red
from dohyo.sumo_networks.seeds import HELD_OUT_FROM
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import LightState, World

if TYPE_CHECKING:
    from dohyo.agents.endless_driving.task import EndlessDriving

EGO = "ego"
MEASURES: Final = (
    "completion", "distance_m", "speed_m_s", "lateral_m", "collision", "red_lights", "left_route", "blocked",
)  # fmt: skip
"""Of an episode: share of the route [%], distance, mean speed, mean distance beside the route, number of red lights
run, and whether it ended by a collision, beside its route, or standing."""
STANDING_M_S, BLOCKED_S = 0.1, 20.0
LIGHT: Final = "light"
"""Observation that only losses read, see `light_ahead`."""
NONE, CLOSED_LIGHT, OPEN_LIGHT = 0.0, 1.0, 2.0
"""Classes of the light ahead."""


class EndlessDrivingEnv(gymnasium.Env[Any, Array]):
    """See the module."""

    def __init__(self, task: EndlessDriving) -> None:
        """Prepares; the simulation starts at `reset`."""
        town = self._town = task.town
        self._view = make_view(town.view, town.max_speed, town.history, town.side)
        self._decoder = TargetSpeed(town.max_speed, town.stand_below)
        told = task.expert
        self._expert: Expert | None = None
        if told is not None:
            self._expert = make_expert(told.name, town.max_speed, town.obey_lights, told.noise)
        asked = self._expert.sensors if self._expert is not None else ()
        self._sensors = tuple(dict.fromkeys((*self._view.sensors, *asked)))
        self.observation_space, self.action_space = task.single_space, task.action_space
        self._driving: DrivingEnv | None = None

    @property
    def driving(self) -> DrivingEnv:
        """The simulation.

        Raises:
            SimulationError: It has not been reset.
        """
        if self._driving is None:
            raise SimulationError("endless driving: the environment has not been reset")
        return self._driving

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Begins the scenario of a seed; held-out ones have one goal."""
        self.close()
        scenario = draw_scenario(self._town.roads, seed or 0, endless=(seed or 0) < HELD_OUT_FROM)
        self._driving = DrivingEnv(scenario, self._sensors, self._decoder.control, reward=None)
        observations, _ = self._driving.reset()
        self._reward = RoachReward(self._town.max_speed, obey_lights=self._town.obey_lights)
        self._view.reset(scenario.missions[0], scenario.seed)
        self._tally = _Tally()
        if self._expert is not None:
            self._expert.reset(scenario)
        return self._look(observations[EGO]), {}

    def step(self, action: Array) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        """Drives for two ticks, or to the episode's end.

        Args:
            action: (2,) see `TargetSpeed`.

        Raises:
            SimulationError: It has not been reset.
        """
        total = 0.0
        for _ in range(ACTION_REPEAT):
            before = self.driving.world
            command = self._decoder.decode(action, self._observation)
            observations, _, _, over, infos = self.driving.step({EGO: command})
            seen, after = self._look(observations[EGO]), self.driving.world
            reward, ended = self._judge(before, after)
            total += reward
            arrived = bool(infos[EGO].get("success", False))
            if ended or over[EGO] or arrived:
                break
        truncated = not ended and (over[EGO] or arrived)
        info = self._tally.info(after, arrived and not ended) if ended or truncated else {}
        return seen, total, ended, truncated, info

    def expert_action(self) -> Float32Array | None:
        """See `Task`."""
        return None if self._expert is None else label(self._advice, self._town.max_speed)

    def close(self) -> None:
        """Ends the simulation."""
        if self._driving is not None:
            self._driving.close()
            self._driving = None

    def _look(self, observation: Observation) -> dict[str, Array]:
        """What the learner observes; the expert sees every tick."""
        self._observation = observation
        if self._expert is not None:
            self._advice = self._expert.advise(self.driving.world, observation)
        return {**self._view.encode(observation), LIGHT: light_ahead(self.driving.world)}

    def _judge(self, before: World, after: World) -> tuple[float, bool]:
        """Reward of one tick, and whether it ends the episode; a stand costs what any ending costs."""
        reward, ended = self._reward(before, after, 0)
        stands = float(after.egos.speed[0]) < STANDING_M_S
        idle = stands and self._reward.desired_speed(after, 0) > 0.0
        blocked = self._tally.add(before, after, idle, ended)
        return reward - float(blocked), ended or blocked


class _Tally:
    """Measures of an episode."""

    def __init__(self) -> None:
        self._ticks, self._speed, self._lateral, self._stood_s = 0, 0.0, 0.0, 0.0
        self._ends = {"collision": False, "left_route": False, "blocked": False}
        self._red_lights = 0

    def add(self, before: World, after: World, idle: bool, ended: bool) -> bool:
        """Counts a tick; whether the ego is blocked.

        Args:
            before: The world before it.
            after: The world after it.
            idle: Whether the ego stands on a free road.
            ended: Whether the reward ended the episode.
        """
        egos = after.egos
        self._ticks, self._speed = self._ticks + 1, self._speed + float(egos.speed[0])
        self._lateral += abs(float(egos.lateral[0]))
        self._stood_s = self._stood_s + TICK_S if idle else 0.0
        ran = passed_red(before, after, 0)
        self._red_lights += ran
        blocked = not ended and self._stood_s > BLOCKED_S
        touched = is_touched(after, 0)
        left = ended and not touched and not ran
        self._ends = {"collision": touched, "left_route": left, "blocked": blocked}
        return blocked

    def info(self, world: World, success: bool) -> dict[str, Any]:
        """The last info of the episode."""
        egos, ticks = world.egos, max(self._ticks, 1)
        share = float(np.clip(egos.progress[0] / world.routes[0].length, 0.0, 1.0))
        means = {"speed_m_s": self._speed / ticks, "lateral_m": self._lateral / ticks}
        reached = {"completion": 100.0 if success else 100.0 * share, "distance_m": float(egos.driven[0])}
        ends = {name: float(value) for name, value in self._ends.items()}
        return {"success": success, "red_lights": float(self._red_lights), **reached, **means, **ends}


def light_ahead(world: World) -> Float32Array:
    """(1,) class of the next light on the route within 18 m."""
    found = next_signal(world, 0, LIGHT_M)
    if found is None or found[1] is LightState.OFF:
        return np.array([NONE], np.float32)
    return np.array([CLOSED_LIGHT if found[1] in CLOSED else OPEN_LIGHT], np.float32)
