"""create_benchmark: drawn missions on a network, in a chosen traffic, by a known protocol."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pydantic import ValidationError

from dohyo.evaluation.benchmarks.benchmark import AutoEvents, Benchmark, ScriptedMission
from dohyo.evaluation.benchmarks.cells import Level, Protocol, carried_traffic, make_cells, traffic_of
from dohyo.evaluation.benchmarks.mission_drawing import Check, Drawing, draw_missions, route_lengths
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.events.auto_events import auto_events
from dohyo.sumo_networks.faults import describe_fault
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.inspection import network_size
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route

LENGTH_M = (300.0, 1500.0)
SHORT_SHARE, LONG_SHARE = 0.25, 0.75
"""Shares of the longest route of a network that bound lengths where it has no routes of `LENGTH_M`."""


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
    fewer: bool = False,
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
        fewer: Whether fewer missions will do where the network has no more.
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
    lengths, check = length_m or fitting_lengths(roads), _check(roads, events)
    drawing = draw_missions(roads, missions, lengths, drawing_seed, check, fewer=fewer)
    made = make_cells(roads, network, drawing.missions[0].mission, traffic, conditions, events)
    drawn = sorted(one.route.length for one in drawing.missions)
    try:
        benchmark = Benchmark(
            name=name,
            description=f"{len(drawn)} missions of {drawn[0]:.0f} to {drawn[-1]:.0f} m on {roads.name}, "
            f"drawn with seed {drawing_seed}",
            cells=made.cells,
            missions={"all": tuple(ScriptedMission(**dict(one.mission)) for one in drawing.missions)},
            seeds=tuple(seeds),
            **protocol.rules,
        )
    except ValidationError as error:
        raise InvalidInputError(f"benchmark '{name}': {describe_fault(error, Benchmark)}") from error
    return Created(benchmark, drawing, made.reduced)


@dataclass(frozen=True, slots=True)
class Capacity:
    """Estimate of the traffic that a network carries.

    Attributes:
        wanted: Number of vehicles in dense traffic.
        carried: Number of vehicles that flowed in the trial: all, a half, a quarter of them, and so on.
        per_km: Number of these vehicles per km of lanes.
    """

    wanted: int
    carried: int
    per_km: float


def estimate_capacity(network: str) -> Capacity:
    """Tries dense traffic on a network for 300 s, and less if it jams.

    Args:
        network: Name in the catalog, or path of a .net.xml[.gz] file.

    Raises:
        InvalidInputError: Nothing can be driven.
    """
    roads = load_network(network)
    mission = draw_missions(roads, 1, fitting_lengths(roads), seed=0).missions[0].mission
    wanted = traffic_of(roads, Level.DENSE)
    carried = carried_traffic(roads, network, mission, wanted).vehicles
    return Capacity(wanted.vehicles, carried, round(carried / max(network_size(roads).lane_km, 0.1), 1))


def fitting_lengths(network: RoadNetwork) -> tuple[float, float]:
    """300 to 1500 m, or shorter ones where the network has no routes of 1500 m.

    Raises:
        InvalidInputError: Nothing can be driven.
    """
    _, longest = route_lengths(network)
    low, high = min(LENGTH_M[0], SHORT_SHARE * longest), min(LENGTH_M[1], LONG_SHARE * longest)
    return float(math.floor(low)), float(math.ceil(high))


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
