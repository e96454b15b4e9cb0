"""Options of environments, which are checked before a process or SUMO starts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from gymnasium.spaces import Box

from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.envs.reward import make_reward
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.sensors import SensorConfig
from dohyo.sumo_networks.units import TICK_S

Option = TypeVar("Option")
SensorNames = Sequence[str | SensorConfig]

DEFAULT_SENSORS = ("speedometer", "route", "objects", "junctions_ahead")
RENDER_MODES = ("rgb_array",)
RENDERING: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": round(1 / TICK_S)}
"""Metadata of every environment about its pictures."""


def by_ego(what: str, option: Option | Mapping[str, Option], egos: Sequence[str]) -> dict[str, Option]:
    """An option of each ego, which is given once for all of them or by name.

    Raises:
        InvalidInputError: An ego has none, or a name is of no ego.
    """
    if not isinstance(option, Mapping):
        return dict.fromkeys(egos, option)
    if set(option) != set(egos):
        raise InvalidInputError(
            f"{what}: expected one entry for each of the egos {', '.join(egos)}, "
            f"got entries for {', '.join(map(str, option)) or 'none'}"
        )
    return dict(option)


def checked_sensors(sensors: object) -> tuple[str | SensorConfig, ...]:
    """Sensors of an ego as a tuple of names and configurations, which may be unknown.

    Raises:
        InvalidInputError: They are no list, or one is neither a name nor a configuration.
    """
    alone = isinstance(sensors, str | SensorConfig | Mapping)  # whose parts would be taken for names
    if alone or not isinstance(sensors, Iterable):
        raise InvalidInputError(f"sensors: expected a list of names or configurations, got {sensors!r}")
    chosen = tuple(sensors)
    for sensor in chosen:
        if not isinstance(sensor, str | SensorConfig):
            raise InvalidInputError(f"sensors: expected a name or a configuration, got {sensor!r}")
    return chosen


def check_names(what: str, names: Iterable[object]) -> None:
    """Raises InvalidInputError if a name is no text."""
    for name in names:
        if not isinstance(name, str):
            raise InvalidInputError(f"{what}: expected a name, got {name!r}")


def check_reward(reward: str | None) -> None:
    """Raises InvalidInputError if a reward function does not exist; None is none."""
    if reward is not None:
        check_names("reward", [reward])
        make_reward(reward)


def check_num_envs(num_envs: object) -> None:
    """Raises InvalidInputError if a number of environments is not a whole number above 0."""
    if isinstance(num_envs, bool) or not isinstance(num_envs, int | np.integer) or num_envs < 1:
        raise InvalidInputError(f"expected at least one environment, a whole number, got num_envs={num_envs!r}")


def checked_scenarios(scenarios: object) -> tuple[Scenario, ...]:
    """One scenario or several as a tuple, each checked by `check_scenario`.

    Raises:
        InvalidInputError: One is no scenario, or has an impossible time limit.
    """
    alone = isinstance(scenarios, str | Config | Mapping)  # whose parts would be taken for scenarios
    found = (scenarios,) if alone or not isinstance(scenarios, Iterable) else tuple(scenarios)
    for scenario in found:
        check_scenario(scenario)
    return found


def check_scenario(scenario: Scenario) -> None:
    """Checks that a scenario is one, and that its time limit is a finite number of seconds above 0.

    A scenario checks its fields when it is made, but not when it is copied with another limit.

    Raises:
        InvalidInputError: It is none, or has an impossible time limit.
    """
    if not isinstance(scenario, Scenario):
        got = repr(scenario) if isinstance(scenario, str | int | float | None) else type(scenario).__name__
        raise InvalidInputError(f"expected a Scenario (see load_benchmark(...).scenarios), got {got}")
    limit_s: Any = scenario.time_limit_s
    number = isinstance(limit_s, int | float | np.integer | np.floating) and not isinstance(limit_s, bool)
    if limit_s is not None and not (number and 0.0 < limit_s < math.inf):
        raise InvalidInputError(
            f"scenario '{scenario.name}': expected a finite time_limit_s above 0, in seconds, got {limit_s!r}"
        )


def check_render_mode(mode: str | None) -> None:
    """Raises InvalidInputError if a render mode does not exist; None draws nothing."""
    if mode is None:
        return
    check_names("render_mode", [mode])
    if mode not in RENDER_MODES:
        raise UnknownNameError("render mode", mode, RENDER_MODES)


def own_space(space: Box) -> Box:
    """A box with the same bounds as that of a chosen sensor or control, and a generator of its own.

    A process shares the boxes of sensors and controls; with one generator, the seed of one environment's space would
    decide the samples of another's.
    """
    return Box(space.low, space.high, dtype=space.dtype)
