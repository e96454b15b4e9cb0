"""create_benchmark: drawn missions on a network, in a chosen traffic, by a known protocol."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import product
from types import MappingProxyType
from typing import Any

from pydantic import ValidationError

from dohyo.evaluation.benchmarks.benchmark import AutoEvents, Benchmark, Cell, ScriptedMission, TimeLimit
from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.evaluation.benchmarks.mission_drawing import Check, Drawing, draw_missions, route_lengths
from dohyo.sumo_networks.conditions import TEST, TRAIN, conditions_named
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.events.auto_events import auto_events
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.scenario import Mission, Scenario, Traffic
from dohyo.sumo_networks.simulation.jam import stuck_share

LENGTH_M = (300.0, 1500.0)
SHORT_SHARE, LONG_SHARE = 0.25, 0.75
"""Shares of the longest route of a network that bound lengths where it has no routes of `LENGTH_M`."""
MOST_STUCK = 0.05
"""Share of vehicles that may stand for long in traffic that flows."""
CONDITION_GROUPS: Mapping[str, tuple[str, ...]] = MappingProxyType({"train": tuple(TRAIN), "test": tuple(TEST)})


class Protocol(StrEnum):
    """Rules by which agents are ranked."""

    LEADERBOARD = "leaderboard"
    NOCRASH = "nocrash"
    CORL2017 = "corl2017"


class Level(StrEnum):
    """Amount of traffic."""

    EMPTY = "empty"
    REGULAR = "regular"
    DENSE = "dense"


_PROTOCOLS: Mapping[Protocol, Mapping[str, Any]] = MappingProxyType(
    {
        Protocol.LEADERBOARD: {
            "headline": Headline.DRIVING_SCORE,
            "metric": "driving score: route completion times infraction penalty, mean over drives "
            "(CARLA Leaderboard 2.0)",
        },
        Protocol.NOCRASH: {
            "headline": Headline.NOCRASH_SUCCESS,
            "metric": "NoCrash success: share of episodes that reach the goal without a collision, in the time that "
            "the route takes at 5 km/h and 20 s more",
            "stop_on_collision": True,
            "time_limit": TimeLimit(speed_kmh=5.0, extra_s=20.0),
        },
        Protocol.CORL2017: {
            "headline": Headline.SUCCESS,
            "metric": "success: share of episodes that reach the goal in time, collisions notwithstanding",
            "time_limit": TimeLimit(speed_kmh=10.0, extra_s=10.0),
        },
    }
)
# As in `nocrash` on town-train, which has 4.9 km of lanes.
_VEHICLES_PER_KM = {Level.EMPTY: 0.0, Level.REGULAR: 4.0, Level.DENSE: 20.0}
_PEDESTRIANS_PER_KM = {Level.EMPTY: 0.0, Level.REGULAR: 10.0, Level.DENSE: 50.0}


@dataclass(frozen=True, slots=True)
class Created:
    """A new benchmark.

    Attributes:
        benchmark: The benchmark.
        drawing: Its missions with their routes, and the routes left out.
        reduced: Number of vehicles that would jam the network, by each level that has fewer for this reason.
    """

    benchmark: Benchmark
    drawing: Drawing
    reduced: Mapping[Level, int]


def create_benchmark(
    name: str,
    network: str,
    *,
    missions: int = 25,
    length_m: tuple[float, float] | None = None,
    traffic: Sequence[Level] = (Level.REGULAR,),
    conditions: Sequence[str] = ("clear",),
    protocol: Protocol = Protocol.LEADERBOARD,
    events: AutoEvents | None = None,
    seeds: Sequence[int] = (0, 1, 2),
    drawing_seed: int = 0,
) -> Created:
    """Creates a benchmark on a network; the same arguments give the same benchmark.

    Args:
        name: Name of the benchmark.
        network: Name in the catalog, or path of a .net.xml[.gz] file.
        missions: Number of missions.
        length_m: Shortest and longest route, m; None: `fitting_lengths`.
        traffic: Amounts of traffic, a cell for each.
        conditions: Groups "train" and "test", a cell for each, or names of conditions, all in one cell.
        protocol: Rules by which agents are ranked.
        events: Rules of the placement of scripted events; None: no events.
        seeds: Seeds that are driven by default.
        drawing_seed: Seed of the drawing of missions.

    Raises:
        UnknownNameError: No network, condition or kind of event has that name.
        InvalidInputError: The network has too few missions of the length, or an argument is invalid.
    """
    roads = load_network(network)
    groups = _condition_groups(conditions)
    drawing = draw_missions(roads, missions, length_m or fitting_lengths(roads), drawing_seed, _check(roads, events))
    mission = drawing.missions[0].mission
    carried = {level: carried_traffic(roads, network, mission, traffic_of(roads, level)) for level in traffic}
    lengths = sorted(one.route.length for one in drawing.missions)
    cells = [
        Cell(
            name=".".join([level, *([group] if group else [])]) if len(traffic) * len(groups) > 1 else "all",
            network=network,
            missions="all",
            traffic=carried[level],
            conditions=names,
            events=events,
        )
        for level, (group, names) in product(traffic, groups.items())
    ]
    try:
        benchmark = Benchmark(
            name=name,
            description=f"{missions} missions of {lengths[0]:.0f} to {lengths[-1]:.0f} m on {roads.name}, "
            f"drawn with seed {drawing_seed}",
            cells=tuple(cells),
            missions={"all": tuple(ScriptedMission(**dict(one.mission)) for one in drawing.missions)},
            seeds=tuple(seeds),
            **_PROTOCOLS[protocol],
        )
    except ValidationError as error:
        raise InvalidInputError(f"benchmark '{name}': {error.errors()[0]['msg']}") from error
    asked = {level: traffic_of(roads, level).vehicles for level in traffic}
    return Created(benchmark, drawing, {level: n for level, n in asked.items() if n > carried[level].vehicles})


def fitting_lengths(network: RoadNetwork) -> tuple[float, float]:
    """300 to 1500 m, or shorter ones where the network has no routes of 1500 m.

    Raises:
        InvalidInputError: Nothing can be driven.
    """
    _, longest = route_lengths(network)
    low, high = min(LENGTH_M[0], SHORT_SHARE * longest), min(LENGTH_M[1], LONG_SHARE * longest)
    return float(math.floor(low)), float(math.ceil(high))


def traffic_of(network: RoadNetwork, level: Level) -> Traffic:
    """Traffic in proportion to the length of a network's lanes."""
    lanes = network.lanes
    km = float(lanes.length[lanes.drivable & ~lanes.internal].sum()) / 1000
    on_foot = bool((lanes.pedestrian & ~lanes.drivable & ~lanes.internal).any())
    return Traffic(
        vehicles=round(_VEHICLES_PER_KM[level] * km),
        pedestrians=round(_PEDESTRIANS_PER_KM[level] * km) if on_foot else 0,
        warm_up_s=0.0 if level is Level.EMPTY else 30.0,
    )


def carried_traffic(roads: RoadNetwork, network: str, mission: Mission, traffic: Traffic) -> Traffic:
    """As much of a traffic as does not jam a network by itself: all, a half, a quarter, and so on.

    Args:
        roads: The roads.
        network: Name in the catalog, or path of a .net.xml[.gz] file.
        mission: Any mission on them.
        traffic: Traffic that is wanted.
    """
    while traffic.vehicles > 1:
        scenario = Scenario(network=network, missions=(mission,), traffic=traffic)
        if stuck_share(roads, scenario) <= MOST_STUCK:
            break
        less = {"vehicles": traffic.vehicles // 2, "pedestrians": traffic.pedestrians // 2}
        traffic = traffic.model_copy(update=less)
    return traffic


def _condition_groups(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Names of conditions by the name of their group; "" for names without a group."""
    groups = {name: CONDITION_GROUPS[name] for name in names if name in CONDITION_GROUPS}
    alone = tuple(name for name in names if name not in CONDITION_GROUPS)
    for name in alone:
        conditions_named(name)
    if groups and alone:
        raise InvalidInputError(f"conditions: expected groups (train, test) or names, got {', '.join(names)}")
    return groups or {"": alone}


def _check(network: RoadNetwork, events: AutoEvents | None) -> Check:
    """Condition on routes: at least one of the events fits."""
    if events is None:
        return lambda route: None

    def check(route: Route) -> str | None:
        try:
            auto_events(network, route, 0, events.kinds, events.every_m)
        except UnknownNameError:
            raise
        except InvalidInputError:
            return "no place for an event"
        return None

    return check
