"""Cells of new benchmarks: a cell for each amount of traffic and each group of conditions, and rules of ranking."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import product
from types import MappingProxyType
from typing import Any

from dohyo.evaluation.benchmarks.benchmark import AutoEvents, Cell, TimeLimit
from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.sumo_networks.conditions import TEST, TRAIN, conditions_named
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.scenario import Mission, Scenario, Traffic
from dohyo.sumo_networks.simulation.jam import stuck_share

MOST_STUCK = 0.05
"""Share of vehicles that may stand for long in traffic that flows."""
CONDITION_GROUPS: Mapping[str, tuple[str, ...]] = MappingProxyType({"train": tuple(TRAIN), "test": tuple(TEST)})


class Protocol(StrEnum):
    """Rules by which agents are ranked."""

    LEADERBOARD = "leaderboard"
    NOCRASH = "nocrash"
    CORL2017 = "corl2017"

    @property
    def rules(self) -> Mapping[str, Any]:
        """Fields of a benchmark: score, time limit, and whether a collision ends a drive."""
        return _RULES[self]


class Level(StrEnum):
    """Amount of traffic."""

    EMPTY = "empty"
    REGULAR = "regular"
    DENSE = "dense"


_RULES: Mapping[Protocol, Mapping[str, Any]] = MappingProxyType(
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
class Cells:
    """The cells of a new benchmark, for the missions called "all".

    Attributes:
        cells: A cell for each amount of traffic and group of conditions.
        reduced: Number of vehicles that would jam the network, by each level that has fewer for this reason.
    """

    cells: tuple[Cell, ...]
    reduced: Mapping[Level, int]


def make_cells(
    roads: RoadNetwork,
    network: str,
    mission: Mission,
    traffic: Traffic | Sequence[Level],
    conditions: Sequence[str],
    events: AutoEvents | None = None,
) -> Cells:
    """Makes the cells, with no more traffic than the network can carry.

    Args:
        roads: The roads.
        network: Name in the catalog, or path of a .net.xml[.gz] file.
        mission: Any mission on them.
        traffic: Traffic of all cells, taken as it is; or amounts, a cell for each.
        conditions: Groups "train" and "test", or names of conditions, all in one cell.
        events: Rules of the placement of scripted events; None: no events.

    Raises:
        UnknownNameError: No condition has that name.
        InvalidInputError: Groups and names of conditions are mixed.
    """
    groups = _condition_groups(conditions)
    if isinstance(traffic, Traffic):
        whole = {"": traffic}
        return Cells(_product(network, whole, groups, events), {})
    wanted = {level: traffic_of(roads, level) for level in traffic}
    carried = {level: carried_traffic(roads, network, mission, one) for level, one in wanted.items()}
    reduced = {level: one.vehicles for level, one in wanted.items() if one.vehicles > carried[level].vehicles}
    return Cells(_product(network, carried, groups, events), reduced)


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


def _product(
    network: str,
    traffic: Mapping[Level, Traffic] | Mapping[str, Traffic],
    groups: Mapping[str, tuple[str, ...]],
    events: AutoEvents | None,
) -> tuple[Cell, ...]:
    """A cell for each named amount of traffic and each named group of conditions."""
    return tuple(
        Cell(
            name=".".join(filter(None, [level, group])) if len(traffic) * len(groups) > 1 else "all",
            network=network,
            missions="all",
            traffic=one,
            conditions=names,
            events=events,
        )
        for (level, one), (group, names) in product(traffic.items(), groups.items())
    )


def _condition_groups(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Names of conditions by the name of their group; "" for names without a group."""
    groups = {name: CONDITION_GROUPS[name] for name in names if name in CONDITION_GROUPS}
    alone = tuple(name for name in names if name not in CONDITION_GROUPS)
    for name in alone:
        conditions_named(name)
    if groups and alone:
        raise InvalidInputError(f"conditions: expected groups (train, test) or names, got {', '.join(names)}")
    return groups or {"": alone}
