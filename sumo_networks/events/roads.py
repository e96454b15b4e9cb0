"""Roads: cross-sections of the road on a route, and the junctions and conflicting paths ahead."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dohyo.sumo_networks.actors.paths import ActorPath, downstream, lane_path, meeting, upstream, wrapped
from dohyo.sumo_networks.events.behavior import PlacementError
from dohyo.sumo_networks.routes.command import Command

if TYPE_CHECKING:  # scenarios are read without roads, whose numeric kernels take long to import
    from dohyo.sumo_networks.networks.network import RoadNetwork
    from dohyo.sumo_networks.routes.route import Passage, Route

ALIGNED_RAD = 0.5
FAST_ROAD_MPS = 20.0


@dataclass(frozen=True, slots=True)
class Section:
    """Cross-section of the road at one point of a route.

    Attributes:
        lane: Lane of the route.
        half_width: Half the width of the route's lane, m.
        left: Next lane to the left in the same direction, -1 if none.
        right: Next lane to the right in the same direction, -1 if none.
        oncoming: First lane of the other direction, to the left, -1 if none.
        kerb_right: Distance from the middle of the route's lane to the right edge of the carriageway, m.
        kerb_left: Distance from the middle of the route's lane to the left edge of the carriageway, m.
        middle: Distance from the middle of the route's lane to the edge of the oncoming lane, m.
    """

    lane: int
    half_width: float
    left: int
    right: int
    oncoming: int
    kerb_right: float
    kerb_left: float
    middle: float


def section(network: RoadNetwork, route: Route, s: float) -> Section:
    """Cross-section of the road at a point of a route.

    Raises:
        PlacementError: The point is past the route's end, or in a junction.
    """
    if s > route.length:
        raise PlacementError(f"the route ends at {route.length:.0f} m, {s:.0f} m are needed")
    if any(passage.entry < s < passage.exit for passage in route.passages):
        raise PlacementError(f"{s:.0f} m is inside a junction")
    lanes, row = network.lanes, route.index(s)
    lane = int(route.lane[row])
    if lanes.internal[lane]:
        raise PlacementError(f"{s:.0f} m is inside a junction")
    edge = [one for one in network.lanes_of_edge[network.edge_id(lane)] if lanes.drivable[one] or lanes.bicycle[one]]
    rank = edge.index(lane)
    half = 0.5 * float(lanes.width[lane])
    right = half + float(sum(lanes.width[one] for one in edge[:rank]))
    middle = half + float(sum(lanes.width[one] for one in edge[rank + 1 :]))
    oncoming, left = _oncoming(network, route, row, middle), middle
    if oncoming >= 0:
        other = network.lanes_of_edge[network.edge_id(oncoming)]
        left += float(sum(lanes.width[one] for one in other if lanes.drivable[one] or lanes.bicycle[one]))
    return Section(lane, half, int(lanes.left[lane]), int(lanes.right[lane]), oncoming, right, left, middle)


def _oncoming(network: RoadNetwork, route: Route, row: int, middle: float) -> int:
    x, y = route.position[row].tolist()
    heading = route.heading.item(row)
    left = middle + 1.5
    x, y = x - left * math.sin(heading), y + left * math.cos(heading)
    none = np.zeros_like(route.on_route)
    lane, offset, error = network.nearest_lane(x, y, heading + math.pi, none)
    fits = lane >= 0 and abs(offset) < 0.5 * network.lanes.width[lane] and abs(error) < ALIGNED_RAD
    return lane if fits and not network.lanes.internal[lane] else -1


def need_clear_road(route: Route, first: float, last: float, through: bool = False) -> None:
    """Checks that a stretch of a route is on one road without junctions; raises PlacementError otherwise.

    Args:
        route: The ego's route.
        first: Arc length of the stretch's start, m.
        last: Arc length of the stretch's end, m.
        through: Whether to allow junctions that the route passes straight on, with right of way and without lights.
    """
    if last > route.length:
        raise PlacementError(f"the route ends at {route.length:.0f} m, {last:.0f} m are needed")
    for passage in route.passages:
        if passage.exit <= first or passage.entry >= last or passage.exit - passage.entry <= 1.0:
            continue
        if not (through and passage.signal < 0 and passage.control == "M" and not turns(passage)):
            raise PlacementError(
                f"there is a junction at {passage.entry:.0f} m, and {first:.0f} to {last:.0f} m must be free"
            )


def need_kerb(network: RoadNetwork, route: Route, s: float) -> Section:
    """Cross-section at a point where people may walk.

    Raises:
        PlacementError: The point is in a junction, past the route's end, or on a road for cars only.
    """
    found = section(network, route, s)
    if network.lanes.speed[found.lane] > FAST_ROAD_MPS:
        raise PlacementError(
            f"people do not walk beside a road with a limit of {network.lanes.speed[found.lane]:.0f} m/s"
        )
    return found


def next_passage(network: RoadNetwork, route: Route, s: float, within_m: float = 150.0) -> Passage:
    """First junction after a point of a route, without places that only join two roads.

    Raises:
        PlacementError: No junction lies within the distance.
    """
    for passage in route.passages:
        if passage.entry > s + within_m:
            break
        met = (network.connections.yields == passage.connection).any()
        if passage.entry >= s and passage.exit - passage.entry > 1.0 and (passage.signal >= 0 or met):
            return passage
    raise PlacementError(f"there is no junction within {within_m:.0f} m")


@dataclass(frozen=True, slots=True)
class ConflictingWay:
    """A path through a junction that meets the ego's path.

    Attributes:
        connection: Index of the connection.
        lanes: Lanes that lead to, through and out of the junction.
        path: Path along the lanes.
        own_s: Arc length of the meeting point on the ego's route, m.
        path_s: Arc length of the meeting point on the path, m.
        side: Side from which the path comes, seen from the ego.
        ego_yields: Whether the ego must give way, without regard to traffic lights.
        merges: Whether both paths continue on the same edge.
    """

    connection: int
    lanes: tuple[int, ...]
    path: ActorPath
    own_s: float
    path_s: float
    side: str
    ego_yields: bool
    merges: bool


def conflicting_ways(network: RoadNetwork, route: Route, passage: Passage, source_m: float) -> list[ConflictingWay]:
    """Paths through a junction that meet the ego's path, in the order of falling length of the approach."""
    own, connections, lanes = passage.connection, network.connections, network.lanes
    rows = {int(b) for a, b in connections.yields if a == own} | {int(a) for a, b in connections.yields if b == own}
    path, found = ActorPath(route.position), []
    heading = float(route.heading[route.index(passage.entry)])
    for connection in sorted(rows):
        source, inside = int(connections.source[connection]), int(connections.target[connection])
        if not (lanes.drivable[source] and lanes.drivable[inside]) or connections.direction[connection] == "t":
            continue
        if lanes.edge[source] == lanes.edge[connections.source[own]]:
            continue
        before, after = upstream(network, source, source_m), downstream(network, inside, 60.0)
        way = lane_path(network, [*before, *after])
        met = meeting(path, passage.entry, min(passage.exit + 5.0, route.length), way)
        if met is None:
            continue
        *_, there = network.lane_point(source, -0.1)
        found.append(
            ConflictingWay(
                connection,
                (*before, *after),
                way,
                *met,
                _side(wrapped(there - heading)),
                (own, connection) in network.gives_way_to,
                network.edge_behind(inside) == network.edge_behind(int(connections.target[own])),
            )
        )
    return sorted(found, key=lambda way: (-min(way.path_s, source_m), way.connection))


def _side(turn: float) -> str:
    """Side from which a vehicle comes whose heading is the ego's plus `turn` [rad]."""
    if abs(turn) > 0.75 * math.pi:
        return "opposite"
    if abs(turn) < 0.25 * math.pi:
        return "same"
    return "right" if turn > 0 else "left"


def crossing_after(network: RoadNetwork, route: Route, passage: Passage) -> float:
    """Arc length at which people cross behind a junction, m: its zebra crossing, or else 5 m behind it.

    Raises:
        PlacementError: The route ends before that point.
    """
    default = passage.exit + 5.0
    if route.length < default + 5.0:
        raise PlacementError("the route ends at the junction")
    first = max(passage.exit - 8.0, 0.0)
    ahead = slice(route.index(first), route.index(passage.exit + 12.0) + 1)
    for crossing in np.flatnonzero(network.lanes.crossing):
        middle = network.lane_shape(int(crossing))
        if np.hypot(*(middle.mean(axis=0) - route.position[ahead.start])).item() > 40.0:
            continue
        met = meeting(ActorPath(route.position[ahead]), 0.0, 40.0, ActorPath(middle))
        if met is not None:
            return first + met[0]
    return default


def turns(passage: Passage) -> bool:
    """Whether the route turns at a junction."""
    return passage.command in (Command.LEFT, Command.RIGHT)
