"""Missions drawn on any road network: reachable, fit to drive, and unlike each other.

Candidates are pairs of lanes whose shortest route has a wanted length. Each mission is the candidate, among a few
random ones, that differs most from the missions chosen before it (Mitchell's best candidate, 1991): by its ends on the
map, its length, its turns and its traffic lights.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix  # type: ignore[import-untyped]
from scipy.sparse.csgraph import dijkstra  # type: ignore[import-untyped]

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.lights import LONGEST_PHASE_S, endless_lights
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.networks.overpasses import find_overpasses
from dohyo.sumo_networks.routes.command import Command
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place

ROOM_BEHIND_M, ROOM_AHEAD_M = 5.0, 10.0
"""Least distances of a start from both ends of its lane: an ego is placed by its centre, and must be able to stop."""
GOAL_ROOM_M = 5.0
START_LANES = 200
"""Lanes from which routes are measured in a large network."""
POOL, CANDIDATES = 4, 8
"""Candidates per mission that are planned, and those that are compared for each choice."""
LANE_CHANGE_M = 1e-3
"""Cost of a lane change in the search for the shortest route, m: a lane change is a choice, not a detour."""
# A compact car at full lock: 2.7 m of wheelbase, 0.6 rad at the front wheels.
MIN_RADIUS_M = 4.0
MIN_LANE_CHANGE_M = 15.0
OVERPASS_ROOM_M = 10.0
"""Least distance of a route from a place where one of its lanes crosses another road without a junction."""

Check = Callable[[Route], str | None]
"""Reason why a route makes no mission; None: it does."""


@dataclass(frozen=True, slots=True)
class DrawnMission:
    """A mission and its route.

    Attributes:
        mission: The mission.
        route: Its route.
    """

    mission: Mission
    route: Route

    def turns(self, command: Command) -> int:
        """Number of junctions at which the route turns in a direction."""
        return sum(passage.command is command for passage in self.route.passages)

    @property
    def all_turns(self) -> int:
        """Number of junctions at which the route turns."""
        return self.turns(Command.LEFT) + self.turns(Command.RIGHT)

    @property
    def lights(self) -> int:
        """Number of junctions with a traffic light."""
        return sum(passage.signal >= 0 for passage in self.route.passages)

    @property
    def features(self) -> FloatArray:
        """(8,) x and y of both ends, length, left turns, right turns, lights."""
        ends = self.route.position[[0, -1]].ravel()
        counts = (self.turns(Command.LEFT), self.turns(Command.RIGHT), self.lights)
        return np.array([*ends, self.route.length, *counts])

    @property
    def summary(self) -> str:
        """Length, turns and lights, for people."""
        left, right = self.turns(Command.LEFT), self.turns(Command.RIGHT)
        return f"{self.route.length:.0f} m, {left} left and {right} right turns, {self.lights} lights"


@dataclass(frozen=True, slots=True)
class Drawing:
    """Missions drawn on a network.

    Attributes:
        missions: Missions, called m01, m02, and so on.
        left_out: Number of routes of the wanted length that make no mission, by reason.
    """

    missions: tuple[DrawnMission, ...]
    left_out: Mapping[str, int]


def draw_missions(
    network: RoadNetwork,
    count: int,
    length_m: tuple[float, float],
    seed: int,
    check: Check = lambda route: None,
    *,
    fewer: bool = False,
) -> Drawing:
    """Draws missions; the same arguments give the same missions. No two begin and end on the same roads.

    Args:
        network: The roads.
        count: Number of missions.
        length_m: Shortest and longest route, m.
        seed: Seed of the drawing.
        check: A further condition on routes.
        fewer: Whether fewer missions, but at least one, will do.

    Raises:
        InvalidInputError: The network has no route of such a length, or fewer missions.
    """
    rng = np.random.default_rng(seed)
    pairs = _LanePairs(network, max(START_LANES, 4 * count), rng)
    pool, left_out = _make_pool(network, pairs, count, length_m, check, rng)
    if len(pool) < (1 if fewer else count):
        raise InvalidInputError(_too_few(network, len(pool), count, length_m, left_out))
    chosen = _choose_unlike(pool, min(count, len(pool)), rng)
    width = max(2, len(str(count)))
    renamed = (
        DrawnMission(one.mission.model_copy(update={"name": f"m{number:0{width}d}"}), one.route)
        for number, one in enumerate(chosen, start=1)
    )
    return Drawing(tuple(renamed), left_out)


def route_lengths(network: RoadNetwork, seed: int = 0) -> tuple[float, float]:
    """Lengths of the shortest and of the longest route of a network that a mission can have, m.

    In a large network, only the routes from some lanes are measured.

    Raises:
        InvalidInputError: No lane leads to another, or all are too short to start on.
    """
    return _LanePairs(network, START_LANES, np.random.default_rng(seed)).range_m


class _LanePairs:
    """Pairs of lanes to start and to end on, with the shortest distance between their beginnings."""

    def __init__(self, network: RoadNetwork, starts: int, rng: np.random.Generator) -> None:
        lanes = network.lanes
        road = lanes.drivable & ~lanes.internal
        self.network, self.name = network, network.name
        fit = np.flatnonzero(road & (lanes.length > ROOM_BEHIND_M + ROOM_AHEAD_M))
        self.goals = np.flatnonzero(road & (lanes.length > 2 * GOAL_ROOM_M))
        self.starts = np.sort(rng.choice(fit, starts, replace=False)) if len(fit) > starts else fit

    @cached_property
    def distance(self) -> FloatArray:
        """(S, G) from the beginning of a start lane to that of a goal lane, m; infinite if there is no way."""
        if not len(self.starts):
            return np.empty((0, len(self.goals)))
        lanes, everything = self.network.lanes, dijkstra(_lane_graph(self.network), indices=self.starts)
        found: FloatArray = everything[:, self.goals]
        found[lanes.edge[self.starts][:, None] == lanes.edge[self.goals]] = np.inf
        return found

    @property
    def shortest(self) -> FloatArray:
        """(S, G) least length of a route between two lanes, m."""
        lengths = self.network.lanes.length
        found: FloatArray = self.distance - (lengths[self.starts] - ROOM_AHEAD_M)[:, None] + GOAL_ROOM_M
        return found

    @property
    def longest(self) -> FloatArray:
        """(S, G) largest length of the shortest route between two lanes, m."""
        found: FloatArray = self.distance - ROOM_BEHIND_M + (self.network.lanes.length[self.goals] - GOAL_ROOM_M)
        return found

    @property
    def range_m(self) -> tuple[float, float]:
        """Lengths of the shortest and of the longest route, m.

        Raises:
            InvalidInputError: There is none.
        """
        connected = np.isfinite(self.distance)
        if not connected.any():
            raise InvalidInputError(f"network '{self.name}' has no two roads, one reachable from the other, for a car")
        return max(0.0, float(self.shortest[connected].min())), float(self.longest[connected].max())

    def of_length(self, low: float, high: float, rng: np.random.Generator) -> IntArray:
        """(N, 2) rows of start and goal lanes with routes of a length, in random order.

        Raises:
            InvalidInputError: There are none.
        """
        found = np.argwhere((self.longest >= low) & (self.shortest <= high))
        if not len(found):
            shortest, longest = self.range_m
            raise InvalidInputError(
                f"network '{self.name}' has no route of {low:g} to {high:g} m: its routes are {shortest:.0f} to "
                f"{longest:.0f} m long"
            )
        return rng.permutation(found)

    def mission(self, pair: IntArray, low: float, high: float, rng: np.random.Generator) -> Mission:
        """A mission between two lanes whose shortest route has a length between two bounds, m."""
        start, goal = int(self.starts[pair[0]]), int(self.goals[pair[1]])
        between, lengths = float(self.distance[pair[0], pair[1]]), self.network.lanes.length
        first, last = GOAL_ROOM_M, float(lengths[goal]) - GOAL_ROOM_M
        begin = (
            max(ROOM_BEHIND_M, between + first - high),
            min(float(lengths[start]) - ROOM_AHEAD_M, between + last - low),
        )
        at = float(rng.uniform(*begin))
        end = float(rng.uniform(max(first, low - between + at), min(last, high - between + at)))
        ids = self.network.lanes.ids
        return Mission(
            start=Place(lane=str(ids[start]), position_m=round(at, 1)),
            goal=Place(lane=str(ids[goal]), position_m=round(end, 1)),
        )


def _lane_graph(network: RoadNetwork) -> csr_matrix:
    """(L, L) lengths of drives from lane to lane, m; a lane change has nearly none, and nobody turns round."""
    lanes, connections = network.lanes, network.connections
    drives = lanes.drivable[connections.source] & lanes.drivable[connections.target] & (connections.direction != "t")
    sources, targets = [connections.source[drives]], [connections.target[drives]]
    costs = [lanes.length[sources[0]]]
    for side in (lanes.left, lanes.right):
        has = np.flatnonzero((side >= 0) & lanes.drivable)
        sources.append(has)
        targets.append(side[has])
        costs.append(np.full(len(has), LANE_CHANGE_M))
    shape = (len(lanes.ids), len(lanes.ids))
    return csr_matrix((np.concatenate(costs), (np.concatenate(sources), np.concatenate(targets))), shape=shape)


def _make_pool(
    network: RoadNetwork,
    pairs: _LanePairs,
    count: int,
    length_m: tuple[float, float],
    check: Check,
    rng: np.random.Generator,
) -> tuple[list[DrawnMission], Counter[str]]:
    """Candidates between different roads, and the routes left out by reason."""
    edge, endless, seen = network.lanes.edge, endless_lights(network), set()
    pool: list[DrawnMission] = []
    left_out: Counter[str] = Counter()
    for pair in pairs.of_length(*length_m, rng):
        roads = int(edge[pairs.starts[pair[0]]]), int(edge[pairs.goals[pair[1]]])
        if roads in seen:
            continue
        mission = pairs.mission(pair, *length_m, rng)
        route = plan_route(network, mission)
        if not length_m[0] <= route.length <= length_m[1]:
            continue  # the fastest route is not always the shortest
        seen.add(roads)
        reason = unfit(network, route, endless) or check(route)
        if reason is None:
            pool.append(DrawnMission(mission, route))
        else:
            left_out[reason] += 1
        if len(pool) == POOL * count:
            break
    return pool, left_out


def unfit(network: RoadNetwork, route: Route, endless: frozenset[str]) -> str | None:
    """Reason why no lawful driver can drive a route in a car; None: there is none.

    Args:
        network: The roads.
        route: A route on them.
        endless: Ids of traffic lights that can be red for longer than a driver may wait.
    """
    signals = [passage.signal for passage in route.passages if passage.signal >= 0]
    if any(str(network.signals.light_ids[network.signals.light[signal]]) in endless for signal in signals):
        return f"a traffic light with a phase of more than {LONGEST_PHASE_S:g} s"
    if any(network.connections.direction[passage.connection] == "t" for passage in route.passages):
        return "turns round"
    if float(np.abs(route.curvature).max()) > 1 / MIN_RADIUS_M:
        return f"a bend of less than {MIN_RADIUS_M:g} m of radius"
    if any(change.end - change.start < MIN_LANE_CHANGE_M for change in route.lane_changes):
        return f"a lane change in less than {MIN_LANE_CHANGE_M:g} m"
    if _passes_overpass(network, route):
        return "a crossing of roads without a junction"
    return None


def _passes_overpass(network: RoadNetwork, route: Route) -> bool:
    """Whether traffic of a road above or below the route would be in its way, since all roads lie in one plane."""
    overpasses = find_overpasses(network)
    places = overpasses.points[route.on_route[overpasses.lanes].any(axis=1)]
    return any((np.hypot(*(route.position - place).T) < OVERPASS_ROOM_M).any() for place in places)


def _choose_unlike(pool: Sequence[DrawnMission], count: int, rng: np.random.Generator) -> Iterator[DrawnMission]:
    """Yields missions of a pool, each unlike those before it."""
    features = np.array([one.features for one in pool])
    spread = features.std(axis=0)
    features = features[:, spread > 0] / spread[spread > 0]
    nearest = np.full(len(pool), np.inf)
    left = np.arange(len(pool))
    for _ in range(count):
        some = rng.choice(left, min(CANDIDATES, len(left)), replace=False)
        best = int(some[np.argmax(nearest[some])])
        yield pool[best]
        nearest = np.minimum(nearest, np.linalg.norm(features - features[best], axis=1))
        left = left[left != best]


def _too_few(
    network: RoadNetwork, found: int, count: int, length_m: tuple[float, float], left_out: Mapping[str, int]
) -> str:
    reasons = "; left out: " + ", ".join(f"{n} with {reason}" for reason, n in left_out.items()) if left_out else ""
    low, high = length_m
    return f"network '{network.name}' has {found} missions of {low:g} to {high:g} m, expected {count}{reasons}"
