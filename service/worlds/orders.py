"""Orders of worlds from requests: the scenario is found or checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pydantic import ValidationError

from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.evaluation.benchmarks.creation import fitting_lengths
from dohyo.evaluation.benchmarks.mission_drawing import draw_missions
from dohyo.service.benchmarks.catalog import find_benchmark
from dohyo.service.networks.finding import find_network
from dohyo.service.worlds.bodies import MOST_EGOS, WorldRequest
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.scenario import Scenario


def scenario_of(request: WorldRequest) -> Scenario:
    """Scenario of a world.

    Raises:
        InvalidInputError: It does not exist, or cannot be used.
    """
    try:
        if request.scenario is not None:
            return _own(request.scenario, "scenario.")
        if request.network is not None:
            return _own(_on_network(find_network(request.network), request), "")
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


def _on_network(network: RoadNetwork, request: WorldRequest) -> dict[str, Any]:
    """Document of a scenario, with drawn missions where their number is given."""
    missions: Sequence[Any] = request.missions if isinstance(request.missions, list) else ()
    if isinstance(request.missions, int):
        drawing = draw_missions(network, request.missions, fitting_lengths(network), request.seed)
        missions = [one.mission.model_dump(mode="json") for one in drawing.missions]
    whole = request.model_dump(include={"network", "traffic", "conditions", "events", "obstacles", "seed"})
    return whole | {"name": network.name, "missions": missions}


def _own(document: dict[str, Any], at: str) -> Scenario:
    try:
        scenario = Scenario.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        raise InvalidInputError(f"{at}{'.'.join(map(str, first['loc']))}: {first['msg']}") from error
    find_network(scenario.network)  # by name only: a path would read files of this machine
    if len(scenario.missions) > MOST_EGOS:
        raise InvalidInputError(f"{at}missions: expected at most {MOST_EGOS}, got {len(scenario.missions)}")
    if scenario.log is not None:
        raise InvalidInputError(f"{at}log: expected none, since a recording does not react to several drivers")
    return scenario
