"""Orders of worlds from requests: the scenario is found or checked."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.service.benchmarks.catalog import find_benchmark
from dohyo.service.networks.finding import find_network
from dohyo.service.worlds.bodies import WorldRequest
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.scenario import Scenario

MOST_EGOS = 64


def scenario_of(request: WorldRequest) -> Scenario:
    """Scenario of a world.

    Raises:
        InvalidInputError: It does not exist, or cannot be used.
    """
    try:
        if request.scenario is not None:
            return _own(request.scenario)
        return _of_benchmark(str(request.benchmark), request.mission, request.seed)
    except UnknownNameError as error:
        raise InvalidInputError(str(error)) from error


def _of_benchmark(name: str, mission: str | None, seed: int) -> Scenario:
    benchmark = find_benchmark(name)
    if not isinstance(benchmark, Benchmark):
        raise InvalidInputError(f"benchmark: expected one of drives, got '{name}'")
    found = {scenario.name: scenario for scenario in benchmark.scenarios([seed])}
    if mission is None:
        return next(iter(found.values()))
    if mission not in found:
        raise UnknownNameError("mission", mission, found)
    return found[mission]


def _own(document: dict[str, Any]) -> Scenario:
    try:
        scenario = Scenario.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(["scenario", *map(str, first["loc"])])
        raise InvalidInputError(f"{where}: {first['msg']}") from error
    find_network(scenario.network)  # by name only: a path would read files of this machine
    if len(scenario.missions) > MOST_EGOS:
        raise InvalidInputError(f"scenario.missions: expected at most {MOST_EGOS}, got {len(scenario.missions)}")
    if scenario.log is not None:
        raise InvalidInputError("scenario.log: expected none, since a recording does not react to several drivers")
    return scenario
