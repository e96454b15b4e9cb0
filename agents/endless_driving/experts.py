"""Experts: what they would do at this moment, as (2,) target speed and steering of the task's actions.

`RuleExpert` is RLfOLD's: its target speed falls linearly to 0 before vehicles, people and lights, and is otherwise the
highest. Any agent can be an expert: the drive that it asks for is turned into the target speed that asks for the same.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from dohyo.agents.registry import resolve
from dohyo.evaluation.agent import Agent, make_agent
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.ego.control import SpeedPid, make_control, pure_pursuit, pursuit_distance
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.envs.reward import RoachReward
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.sensors import Observation
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import World

RULES = "rules"


class Expert(Protocol):
    """An expert of one environment.

    Attributes:
        sensors: Names of the sensors that it reads.
    """

    sensors: tuple[str, ...]

    def reset(self, scenario: Scenario) -> None:
        """Forgets the last episode."""

    def advise(self, world: World, observation: Observation) -> tuple[float, float]:
        """Target speed [m/s] and steering [-1 to 1 of full lock]; called in every tick."""


class RuleExpert:
    """The target speed of Roach's reward, and pure pursuit along the route; see `Expert`."""

    sensors: tuple[str, ...] = ("speedometer", "route")

    def __init__(self, max_speed: float, obey_lights: bool) -> None:
        """Prepares.

        Args:
            max_speed: On a free road, m/s.
            obey_lights: Whether lights and stop signs count.
        """
        self._max_speed, self._obey_lights, self._vehicle = max_speed, obey_lights, VehicleParameters()
        self._rule = RoachReward(max_speed, obey_lights=obey_lights)

    def reset(self, scenario: Scenario) -> None:
        """See `Expert`."""
        self._rule = RoachReward(self._max_speed, obey_lights=self._obey_lights)

    def advise(self, world: World, observation: Observation) -> tuple[float, float]:
        """See `Expert`."""
        aim = observation["route"][round(pursuit_distance(float(observation["speedometer"][0])))]
        steering = pure_pursuit(self._vehicle, float(aim[0]), float(aim[1])) / self._vehicle.max_steering
        return self._rule.desired_speed(world, 0), steering


class AgentExpert:
    """A registered agent, such as `autopilot` or `priboot`; see `Expert`."""

    def __init__(self, name: str) -> None:
        """Makes the agent.

        Raises:
            UnknownNameError: No agent is registered under the name.
        """
        self._agent: Agent = make_agent(resolve(name), {})
        self._agent.warm_up()
        self.sensors = tuple(self._agent.spec.sensors)
        self._vehicle = VehicleParameters()
        self._control = make_control(self._agent.spec.control, self._vehicle, TICK_S)
        self._gain = SpeedPid(self._vehicle, TICK_S).gain

    def reset(self, scenario: Scenario) -> None:
        """See `Expert`."""
        self._control = make_control(self._agent.spec.control, self._vehicle, TICK_S)
        self._agent.reset(scenario.missions[0], scenario.seed)

    def advise(self, world: World, observation: Observation) -> tuple[float, float]:
        """See `Expert`."""
        action = self._agent.act({name: observation[name] for name in self.sensors})
        drive, angle = self._control.command(action, world, 0)
        speed = float(world.egos.speed[0])
        return speed + (drive - self._vehicle.resistance(speed)) / self._gain, angle / self._vehicle.max_steering


class NoisyExpert:
    """Another expert, some of whose decisions are replaced by random ones; see `Expert`.

    Attributes:
        sensors: Of the other expert.
    """

    HELD_TICKS = 10
    """A random decision is kept for a second: one of a tenth hardly changes what the vehicle does."""

    def __init__(self, inner: Expert, share: float, max_speed: float) -> None:
        """Prepares.

        Args:
            inner: The other expert.
            share: Part of the seconds in which the target speed is random.
            max_speed: Highest random target speed, m/s.
        """
        self.sensors = inner.sensors
        self._inner, self._share, self._max_speed = inner, share, max_speed
        self._rng, self._ticks, self._random = np.random.default_rng(0), 0, -1.0

    def reset(self, scenario: Scenario) -> None:
        """See `Expert`."""
        self._rng, self._ticks = np.random.default_rng([2, scenario.seed]), 0
        self._inner.reset(scenario)

    def advise(self, world: World, observation: Observation) -> tuple[float, float]:
        """See `Expert`."""
        if self._ticks % self.HELD_TICKS == 0:
            wrong = self._rng.random() < self._share
            self._random = float(self._rng.uniform(0.0, self._max_speed)) if wrong else -1.0
        self._ticks += 1
        speed, steering = self._inner.advise(world, observation)
        return (speed if self._random < 0.0 else self._random), steering


def check_expert(name: str) -> None:
    """Checks that there is an expert of a name, see `make_expert`.

    Raises:
        UnknownNameError: No agent has the name.
        InvalidInputError: The agent cannot be made, such as one without weights.
    """
    if name != RULES:
        make_agent(resolve(name)).close()


def make_expert(name: str, max_speed: float, obey_lights: bool, noise: float) -> Expert:
    """The expert of a name.

    Args:
        name: "rules", or the registered name of an agent.
        max_speed: On a free road, m/s.
        obey_lights: Whether the rules know lights.
        noise: Share of random decisions.

    Raises:
        UnknownNameError: No agent is registered under the name.
    """
    expert: Expert = RuleExpert(max_speed, obey_lights) if name == RULES else AgentExpert(name)
    return NoisyExpert(expert, noise, max_speed) if noise else expert


def label(advice: tuple[float, float], max_speed: float) -> Float32Array:
    """(2,) the action of the task that follows an advice, clipped to [-1, 1]."""
    speed, steering = advice
    return np.clip(np.array([2.0 * speed / max_speed - 1.0, steering], np.float32), -1.0, 1.0)
