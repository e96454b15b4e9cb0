"""ScenarioEnv: one environment of many, which drives another scenario in each episode."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from gymnasium.spaces import Dict
from numpy.typing import NDArray

from dohyo.sumo_networks.ego.control import make_control
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.envs.options import (
    DEFAULT_SENSORS,
    SensorNames,
    check_names,
    check_num_envs,
    check_render_mode,
    check_reward,
    check_scenario,
    checked_scenarios,
    checked_sensors,
    own_space,
)
from dohyo.sumo_networks.envs.process_vector_env import ProcessVectorEnv
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.seeds import HELD_OUT_FROM
from dohyo.sumo_networks.sensors import Observation, make_sensors
from dohyo.sumo_networks.units import TICK_S

ScenarioSource = Sequence[Scenario] | Callable[[int], Scenario]
"""Scenarios, which repeat; or a function from an episode's number to its scenario."""


def scenario_rows(
    scenarios: ScenarioSource,
    num_envs: int,
    sensors: SensorNames = DEFAULT_SENSORS,
    control: str = "target_speed_steering",
    reward: str | None = "roach",
    render_mode: str | None = None,
) -> ProcessVectorEnv:
    """Environments of scenarios, one process each, whose egos are rows; SUMO starts at `reset`.

    An episode with seed s drives scenario s of the source with seed s. Its last info has "success".

    Args:
        scenarios: One or more scenarios with the same number of egos; or a function, which the workers import and call.
        num_envs: Number of environments.
        sensors: Names from `sensors.SENSORS` or sensor configurations, for all egos.
        control: Name from `control.CONTROLS`, for all egos.
        reward: Name from `reward.REWARDS`; None: rewards are 0 and only the goal terminates.
        render_mode: "rgb_array" for pictures from `render`.

    Raises:
        InvalidInputError: A name is unknown, no scenario is given, or scenarios differ in the number of egos.
    """
    check_num_envs(num_envs)
    chosen = checked_sensors(sensors)
    check_names("control", [control])
    check_reward(reward)
    check_render_mode(render_mode)
    scenarios = scenarios if callable(scenarios) else checked_scenarios(scenarios)
    egos = count_egos(scenarios)
    return ProcessVectorEnv(
        make_env=partial(ScenarioEnv, scenarios, egos, (chosen, control, reward, render_mode)),
        num_envs=num_envs * egos,
        observation_space=Dict({sensor.name: own_space(sensor.space) for sensor in make_sensors(chosen)}),
        action_space=own_space(make_control(control, VehicleParameters(), TICK_S).space),
        group_size=egos,
    )


class ScenarioEnv:
    """A DrivingEnv per scenario, in the form of PettingZoo's ParallelEnv; one of them is open at a time."""

    def __init__(
        self,
        scenarios: ScenarioSource,
        egos: int,
        options: tuple[SensorNames, str, str | None, str | None],
        rank: int,
    ) -> None:
        """Prepares; SUMO starts at `reset`.

        Args:
            scenarios: Source of the scenarios.
            egos: Number of egos that every scenario must have.
            options: Sensors, control, reward and render mode of `DrivingEnv`.
            rank: Number of this environment among all.
        """
        self._scenarios, self._egos, self._options, self._rank = scenarios, egos, options, rank
        self._env: DrivingEnv | None = None

    @property
    def possible_agents(self) -> Sequence[str]:
        """Names of the missions."""
        return self._started.possible_agents

    @property
    def agents(self) -> Sequence[str]:
        """Names of the egos still driving."""
        return self._started.agents

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begins an episode.

        Args:
            seed: Seed of the scenario; None: a random one.
            options: "episodes": by rank, the number of the episode in its run, which chooses the scenario; the seed
                does without it.

        Raises:
            InvalidInputError: The scenario is impossible, or has another number of egos.
            SimulationError: SUMO failed.
        """
        seed = int(np.random.default_rng().integers(HELD_OUT_FROM)) if seed is None else seed
        scenario = self._scenario(int(options["episodes"][self._rank]) if options else seed)
        env = self._env
        if env is None or env.scenario != scenario.model_copy(update={"seed": env.scenario.seed}):
            self.close()
            env = self._env = DrivingEnv(scenario, *self._options)
        return env.reset(seed=seed)

    def step(self, actions: Mapping[str, Any]) -> tuple[dict[str, Any], ...]:
        """See `DrivingEnv.step`."""
        return self._started.step(actions)

    def render(self) -> NDArray[np.uint8] | None:
        """See `DrivingEnv.render`."""
        return self._started.render()

    def close(self) -> None:
        """Ends SUMO."""
        if self._env is not None:
            self._env.close()
            self._env = None

    @property
    def _started(self) -> DrivingEnv:
        if self._env is None:
            raise SimulationError(f"environment {self._rank} has not been reset")
        return self._env

    def _scenario(self, episode: int) -> Scenario:
        if not callable(self._scenarios):
            return self._scenarios[episode % len(self._scenarios)]
        scenario = self._scenarios(episode)
        if len(scenario.missions) != self._egos:
            raise InvalidInputError(
                f"scenario of episode {episode}: expected {self._egos} egos, got {len(scenario.missions)}"
            )
        return scenario


def count_egos(scenarios: ScenarioSource) -> int:
    """Number of egos of every scenario.

    Raises:
        InvalidInputError: There is no scenario, their numbers of egos differ, or the function gives no scenario.
    """
    if callable(scenarios):
        check_scenario(scenarios(0))
        return len(scenarios(0).missions)
    counts = sorted({len(scenario.missions) for scenario in scenarios})
    if len(counts) != 1:
        raise InvalidInputError(f"expected scenarios with the same number of egos, got {counts or 'no scenario'}")
    return counts[0]
