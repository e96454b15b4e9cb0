"""Orders of worlds from requests: the scenario is found or checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from pydantic import ValidationError

from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.evaluation.benchmarks.creation import fitting_lengths
from dohyo.evaluation.benchmarks.mission_drawing import draw_missions
from dohyo.service.benchmarks.catalog import find_benchmark
from dohyo.service.networks.finding import find_network
from dohyo.service.worlds.bodies import MOST_EGOS, WorldRequest
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.faults import describe_fault
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.scenario import Mission, Place, Scenario

_SPARE: Final = 4
"""Missions drawn for each that is wanted where some starts are too near each other."""
_APART_M: Final = 8.0
"""Least distance between two starts on a lane: a car and some room."""


def scenario_of(request: WorldRequest) -> Scenario:
    """Scenario of a world.

    Raises:
        InvalidInputError: It does not exist, or cannot be used.
    """
    try:
        if request.scenario is not None:
            return _own(request.scenario, "scenario")
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
        drawn = _drawn(network, request.missions, request.seed)
        missions = [one.model_dump(mode="json") for one in drawn]
    whole = request.model_dump(include={"network", "traffic", "conditions", "events", "obstacles", "seed"})
    return whole | {"name": network.name, "missions": missions}


def _drawn(network: RoadNetwork, count: int, seed: int) -> list[Mission]:
    """Drawn missions whose cars do not touch at their starts."""
    lengths, apart = fitting_lengths(network), list[Mission]()
    for more in (count, _SPARE * count):
        apart = []
        for one in draw_missions(network, more, lengths, seed, fewer=more > count).missions:
            if not any(_near(one.mission.start, other.start) for other in apart):
                apart.append(one.mission)
        if len(apart) >= count:
            return [one.model_copy(update={"name": f"m{n:02d}"}) for n, one in enumerate(apart[:count], start=1)]
    raise InvalidInputError(f"missions: expected {count} that start apart, '{network.name}' has {len(apart)}")


def _near(one: Place, other: Place) -> bool:
    return one.lane == other.lane and abs(one.position_m - other.position_m) < _APART_M


def _own(document: dict[str, Any], at: str) -> Scenario:
    try:
        scenario = Scenario.model_validate(document)
    except ValidationError as error:
        told = describe_fault(error, Scenario, document)
        placed = any(one["loc"] for one in error.errors())
        raise InvalidInputError(told if not at else f"{at}.{told}" if placed else f"{at}: {told}") from error
    before = f"{at}." if at else ""
    find_network(scenario.network)  # by name only: a path would read files of this machine
    if len(scenario.missions) > MOST_EGOS:
        raise InvalidInputError(f"{before}missions: expected at most {MOST_EGOS}, got {len(scenario.missions)}")
    if scenario.log is not None:
        raise InvalidInputError(f"{before}log: expected none, since a recording does not react to several drivers")
    return scenario
