"""SingleDrivingEnv: scenarios with one ego as a gymnasium environment."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.envs.options import DEFAULT_SENSORS, RENDERING, SensorNames, checked_scenarios
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.seeds import HELD_OUT_FROM
from dohyo.sumo_networks.sensors import Observation


class SingleDrivingEnv(gymnasium.Env[Observation, NDArray[Any]]):
    """A DrivingEnv for one ego, without agent names; every episode draws a scenario and a seed.

    `reset(seed=...)` sets the generator of that draw and of all later ones. Since libsumo is global, a process runs one
    episode at a time: a reset ends the episode of any other SingleDrivingEnv in the process, which must then be reset
    before its next step. For several at once, use `VectorDrivingEnv` or gymnasium's AsyncVectorEnv.

    Attributes:
        scenarios: Scenarios to draw from.
        observation_space: One Box per sensor; gymnasium's FlattenObservation makes one Box of them.
        action_space: Space of the control interface; values outside its bounds are clipped.
        render_mode: "rgb_array" or None.

    Source: gymnasium's Env interface.
    """

    metadata: ClassVar[dict[str, Any]] = {**RENDERING}  # type: ignore[misc]
    _latest: ClassVar[weakref.ref[SingleDrivingEnv] | None] = None

    def __init__(
        self,
        scenarios: Scenario | Sequence[Scenario],
        sensors: SensorNames = DEFAULT_SENSORS,
        control: str = "target_speed_steering",
        reward: str | None = "roach",
        render_mode: str | None = None,
    ) -> None:
        """Checks every name; SUMO starts at `reset`.

        Args:
            scenarios: One or more, each with one mission.
            sensors: Names from `sensors.SENSORS` or sensor configurations.
            control: Name from `control.CONTROLS`.
            reward: Name from `reward.REWARDS`; None: rewards are 0 and only the goal terminates.
            render_mode: "rgb_array" for pictures from `render`.

        Raises:
            InvalidInputError: A name is unknown, no scenario is given, or a scenario has several egos or is impossible.
        """
        self.scenarios = checked_single(scenarios)
        self.render_mode = render_mode
        self._options = (sensors, control, reward, render_mode)
        self._env = DrivingEnv(self.scenarios[0], *self._options)
        self._drawn = 0
        self.observation_space: gymnasium.spaces.Dict = self._env.observation_space(self._ego)  # type: ignore[assignment]
        self.action_space: gymnasium.spaces.Box = self._env.action_space(self._ego)

    @property
    def driving_env(self) -> DrivingEnv:
        """The environment of the current scenario, with the world, the routes and the scenario itself."""
        return self._env

    @property
    def _ego(self) -> str:
        return self._env.possible_agents[0]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Draws a scenario and a seed below 2^30, and starts the episode.

        Args:
            seed: Seed of this draw and of all later ones.
            options: Unused.

        Returns:
            The observation, and infos with the "scenario" and its "seed".

        Raises:
            InvalidInputError: The network cannot carry this traffic, or the mission is impossible.
            SimulationError: SUMO failed, or a DrivingEnv of this process is still open.
        """
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(len(self.scenarios)))
        scenario_seed = int(self.np_random.integers(HELD_OUT_FROM))
        if drawn != self._drawn:
            self._env.close()
            self._env, self._drawn = DrivingEnv(self.scenarios[drawn], *self._options), drawn
        self._take_over()
        observations, _ = self._env.reset(seed=scenario_seed)
        return observations[self._ego], {"scenario": self.scenarios[drawn].name, "seed": scenario_seed}

    def step(self, action: NDArray[Any]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drives for one tick of 0.1 s; see `DrivingEnv.step`.

        Raises:
            ResetNeeded: The episode has ended, by itself or by the reset of another environment.
            InvalidActionError: The action has a wrong shape or is not finite; the simulation is then unchanged.
            SimulationError: SUMO failed.
        """
        ego = self._ego
        if ego not in self._env.agents:
            raise ResetNeeded(
                "expected reset() before step(): the episode has ended, none has begun, or another environment of this "
                "process was reset"
            )
        observations, rewards, terminations, truncations, infos = self._env.step({ego: action})
        ended = bool(terminations[ego]), bool(truncations[ego])
        return observations[ego], float(rewards[ego]), *ended, infos[ego]

    def render(self) -> NDArray[np.uint8] | None:
        """(480, 480, 3) RGB picture from above; None without a render mode."""
        return self._env.render()

    def _take_over(self) -> None:
        """Ends the episode of another environment of this process."""
        other = None if SingleDrivingEnv._latest is None else SingleDrivingEnv._latest()
        if other is not None and other is not self:
            other.close()
        SingleDrivingEnv._latest = weakref.ref(self)

    def close(self) -> None:
        """Ends SUMO."""
        self._env.close()


def checked_single(scenarios: Scenario | Sequence[Scenario]) -> tuple[Scenario, ...]:
    """Scenarios with exactly one ego each, and a time limit that can pass.

    Raises:
        InvalidInputError: No scenario is given, or one is no scenario, has several egos or an impossible time limit.
    """
    found = checked_scenarios(scenarios)
    if not found:
        raise InvalidInputError("expected at least one scenario, got none")
    for scenario in found:
        if len(scenario.missions) != 1:
            raise InvalidInputError(
                f"scenario '{scenario.name}': expected one ego, got {len(scenario.missions)} (see DrivingEnv)"
            )
    return found
