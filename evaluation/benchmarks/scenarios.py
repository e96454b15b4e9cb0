"""Scenarios of a benchmark: one per cell, mission and seed, with events and conditions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np

from dohyo.evaluation.benchmarks.benchmark import Benchmark, Cell, Excerpt, ScriptedMission
from dohyo.sumo_networks.conditions import conditions_named
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.events import Event
from dohyo.sumo_networks.events.auto_events import auto_events
from dohyo.sumo_networks.events.placement import check_placement, trigger_of
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Scenario
from dohyo.sumo_networks.seeds import episode_seeds
from dohyo.sumo_networks.units import KMH_PER_MPS


def make_scenarios(benchmark: Benchmark, seeds: Sequence[int]) -> list[Scenario]:
    """See `Benchmark.scenarios`."""
    try:
        seeds = episode_seeds(seeds)
    except InvalidInputError as error:
        raise InvalidInputError(f"benchmark '{benchmark.name}': {error}") from error
    if benchmark.excerpts and seeds != [0]:
        raise InvalidInputError(
            f"the missions of benchmark '{benchmark.name}' have seeds of their own; leave out the seeds"
        )
    if repeated := [seed for seed, times in Counter(seeds).items() if times > 1]:
        raise InvalidInputError(f"benchmark '{benchmark.name}': expected every seed once, got {repeated[0]} again")
    return [scenario for seed in seeds for cell in benchmark.cells for scenario in _scenarios(benchmark, cell, seed)]


def _scenarios(benchmark: Benchmark, cell: Cell, seed: int) -> Iterator[Scenario]:
    missions = benchmark.missions[cell.missions]
    lengths = [_length(benchmark, cell, number, mission) for number, mission in enumerate(missions, start=1)]
    names = iter(benchmark.scenario_names(cell))
    if cell.together:
        egos = tuple(mission.mission(mission.name) for mission in missions)
        events = [
            event
            for number, mission in enumerate(missions)
            for event in _events(benchmark, cell, number, mission, mission.name, seed, together=True)
        ]
        for conditions in _conditions(benchmark, cell, turn=seed):
            yield _scenario(benchmark, cell, next(names), egos, events, conditions, max(lengths), seed)
        return
    for number, (mission, length) in enumerate(zip(missions, lengths, strict=True)):
        events = _events(benchmark, cell, number, mission, "ego", seed, together=False)
        ego = (mission.mission("ego"),)
        for conditions in _conditions(benchmark, cell, turn=number):
            scenario = _scenario(benchmark, cell, next(names), ego, events, conditions, length, seed)
            yield scenario if mission.excerpt is None else _excerpted(benchmark, scenario, mission.excerpt)


def _conditions(benchmark: Benchmark, cell: Cell, turn: int) -> tuple[str, ...]:
    """Conditions of the scenarios of one mission: all of the cell, or the next of them in turn."""
    return cell.conditions if benchmark.every_condition else (cell.conditions[turn % len(cell.conditions)],)


def _excerpted(benchmark: Benchmark, scenario: Scenario, excerpt: Excerpt) -> Scenario:
    warmed_up = scenario.traffic.model_copy(update={"warm_up_s": excerpt.warm_up_s})
    return scenario.model_copy(
        update={
            "seed": excerpt.seed,
            "traffic": warmed_up,
            "reference_m": excerpt.reference_m,
            "log": excerpt.log if benchmark.replay else None,
        }
    )


def _events(
    benchmark: Benchmark, cell: Cell, number: int, mission: ScriptedMission, ego: str, seed: int, *, together: bool
) -> list[Event]:
    """The events on one mission: first those given by hand, then those of the cell at a distance from them."""
    if not mission.events and cell.events is None:
        return []
    network, route = load_network(cell.network), _route(cell.network, mission.mission(mission.name))
    changes = (lambda event: {"ego": ego, "name": f"{ego}-{event.name}"}) if together else (lambda _: {"ego": None})
    found = [event.model_copy(update=changes(event)) for event in mission.events]
    try:
        for event in found:
            check_placement(event, ego, network, route)
        if cell.events is not None:
            drawn = int(np.random.SeedSequence(seed, spawn_key=(number,)).generate_state(1)[0])
            auto = cell.events
            placed = auto_events(network, route, drawn, auto.kinds, auto.every_m, ego if together else None)
            by_hand = [trigger_of(event, network, route) for event in found]
            found += [
                event
                for event in placed
                if all(abs(trigger_of(event, network, route) - at) >= auto.every_m[0] for at in by_hand)
            ]
    except InvalidInputError as error:
        raise InvalidInputError(f"benchmark '{benchmark.name}', mission {number + 1}: {error}") from error
    names = [event.name for event in found]
    if len(set(names)) != len(names):
        raise InvalidInputError(
            f"benchmark '{benchmark.name}', mission {number + 1}: event names must be unique, got {names}"
        )
    return found


def _length(benchmark: Benchmark, cell: Cell, number: int, mission: ScriptedMission) -> float:
    try:
        return _route(cell.network, mission.mission(mission.name)).length
    except InvalidInputError as error:
        raise InvalidInputError(f"benchmark '{benchmark.name}', mission {number}: {error}") from error


def _scenario(
    benchmark: Benchmark,
    cell: Cell,
    name: str,
    missions: tuple[Mission, ...],
    events: Sequence[Event],
    conditions: str,
    longest: float,
    seed: int,
) -> Scenario:
    conditions_named(conditions)
    limit = benchmark.time_limit
    return Scenario(
        name=name,
        cell=cell.name,
        network=cell.network,
        missions=missions,
        traffic=cell.traffic,
        conditions=conditions,
        events=tuple(events),
        stop_on_collision=benchmark.stop_on_collision,
        time_limit_s=round(longest / (limit.speed_kmh / KMH_PER_MPS) + limit.extra_s, 1) if limit else None,
        seed=seed,
        duration_s=benchmark.duration_s,
    )


@cache
def _route(network: str, mission: Mission) -> Route:
    return plan_route(load_network(network), mission)
