"""Environments for learning: the missions of a benchmark or of own scenarios, with one ego per episode.

Episodes may differ from those of an evaluation: a reward enters no score, and seeds of benchmarks are not drawn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gymnasium.vector import AutoresetMode
from pydantic import ValidationError

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.criteria.route_timeout import RouteTimeout
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.envs.single_env import SingleDrivingEnv, checked_single
from dohyo.sumo_networks.envs.vector_env import VectorDrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.faults import describe_fault
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Scenario, Traffic

Source = str | Benchmark | Scenario | Sequence[Scenario]


def make_env(source: Source | None = None, **options: Any) -> SingleDrivingEnv:
    """A gymnasium environment that draws one scenario per episode.

    Args:
        source: Source of scenarios, see `single_scenarios`.
        **options: Options of `single_scenarios` and of `SingleDrivingEnv`.

    Raises:
        InvalidInputError: An unknown name, or scenarios with several egos.
    """
    scenarios, rest = _split(source, options)
    return SingleDrivingEnv(scenarios, **rest)


def make_vec(source: Source | None = None, num_envs: int = 1, **options: Any) -> VectorDrivingEnv:
    """A gymnasium vector environment of several processes, each of which drives the scenarios in turn.

    Args:
        source: Source of scenarios, see `single_scenarios`.
        num_envs: Number of processes.
        **options: Options of `single_scenarios` and of `VectorDrivingEnv`. The default autoreset mode is NEXT_STEP,
            which gymnasium's vector wrappers need.

    Raises:
        InvalidInputError: An unknown name, or scenarios with several egos.
    """
    scenarios, rest = _split(source, options)
    return VectorDrivingEnv(scenarios, num_envs, **{"autoreset_mode": AutoresetMode.NEXT_STEP, **rest})


def single_scenarios(
    source: Source | None = None,
    *,
    network: str | None = None,
    missions: Sequence[Mission | Mapping[str, Any]] | None = None,
    traffic: Traffic | Mapping[str, Any] | None = None,
    conditions: str | None = None,
    time_limit_s: float | None = None,
) -> tuple[Scenario, ...]:
    """Scenarios with one ego and a time limit each.

    Args:
        source: Benchmark, or its name, or scenarios; None: one scenario per mission on the network.
        network: Name of a network in the catalog; only without a source, as are the next three arguments.
        missions: Missions to drive there.
        traffic: Traffic around every mission.
        conditions: Conditions of the road, light and air; None: clear.
        time_limit_s: Time limit of every episode, s; None: that of the scenario, else that of the CARLA Leaderboard.

    Raises:
        InvalidInputError: An unknown name, both or neither of a source and a network, arguments of a network beside a
            source, scenarios with several egos, or missions that begin in recorded traffic, or are no missions.
    """
    if (source is None) == (network is None):
        raise InvalidInputError("expected either a benchmark or scenarios, or a network with missions")
    own = {"missions": missions, "traffic": traffic, "conditions": conditions}
    given = {name: value for name, value in own.items() if value is not None}
    found: Scenario | Sequence[Scenario]
    if network is not None:
        found = _of_missions({"missions": (), "traffic": {}, "conditions": "clear", **given, "network": network})
    elif given:
        raise InvalidInputError(
            f"{', '.join(given)}: only for a network, got a benchmark or scenarios, which have their own"
        )
    elif isinstance(source, str | Benchmark):
        found = _of_benchmark(load_benchmark(source) if isinstance(source, str) else source)
    else:
        found = source or ()
    single = checked_single(found)
    limits = (_limit(scenario) if time_limit_s is None else time_limit_s for scenario in single)
    return tuple(
        scenario.model_copy(update={"time_limit_s": limit}) for scenario, limit in zip(single, limits, strict=True)
    )


class _OwnMissions(Config):
    """Missions on a network, each an episode."""

    network: str
    missions: tuple[Mission, ...]
    traffic: Traffic
    conditions: str


def _of_missions(given: Mapping[str, Any]) -> list[Scenario]:
    try:
        own = _OwnMissions.model_validate(given)
    except ValidationError as error:
        raise InvalidInputError(describe_fault(error, _OwnMissions, given)) from error
    return [
        Scenario(
            name=f"mission-{number}",
            network=own.network,
            missions=(mission.model_copy(update={"name": "ego"}),),
            traffic=own.traffic,
            conditions=own.conditions,
        )
        for number, mission in enumerate(own.missions, start=1)
    ]


def _of_benchmark(benchmark: Benchmark) -> list[Scenario]:
    """The scenarios of a benchmark, with the scripted events of its first seed."""
    if benchmark.excerpts:
        raise InvalidInputError(
            f"benchmark '{benchmark.name}': its missions begin amid recorded traffic, with seeds of their own"
        )
    return benchmark.scenarios(benchmark.seeds[:1])


def _limit(scenario: Scenario) -> float:
    """The time limit of a scenario, else that of `RouteTimeout`, s."""
    if scenario.time_limit_s is not None:
        return scenario.time_limit_s
    route = plan_route(load_network(scenario.network), scenario.missions[0])
    return round(RouteTimeout().allowed_s(route), 1)


def _split(source: Source | None, options: Mapping[str, Any]) -> tuple[tuple[Scenario, ...], dict[str, Any]]:
    """The scenarios, and the options of the environment."""
    names = ("network", "missions", "traffic", "conditions", "time_limit_s")
    ours = {name: value for name, value in options.items() if name in names}
    return single_scenarios(source, **ours), {name: value for name, value in options.items() if name not in names}
