"""Routing: the A* search over lanes that finds a mission's route."""

from __future__ import annotations

import heapq
import math

import numpy as np

from dohyo.sumo_networks.config import Mission, Place
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route, build_route

MIN_LENGTH_M = 2.0
LANE_CHANGE_COST_S = 5.0
SHORT_LANE_CHANGE_COST_S = 60.0
MIN_LANE_CHANGE_M = 20.0
TURNAROUND_COST_S = 60.0


def plan_route(network: RoadNetwork, mission: Mission) -> Route:
    """The fastest lane-level route of a mission.

    Raises:
        InvalidInputError: A lane does not exist or is closed to cars, or no route leads to the goal.
    """
    start, goal = _place(network, mission, "start", mission.start), _place(network, mission, "goal", mission.goal)
    lanes = _search(network, *start, *goal, [_via(network, mission, edge) for edge in mission.via])
    if lanes is None:
        via = f" via {', '.join(mission.via)}" if mission.via else ""
        raise InvalidInputError(
            f"mission '{mission.name}': no lane-level route leads from '{mission.start.lane}'{via} to goal lane "
            f"'{mission.goal.lane}' for passenger cars"
        )
    if len(lanes) == 1 and goal[1] - start[1] < MIN_LENGTH_M:
        raise InvalidInputError(f"mission '{mission.name}': start and goal are less than {MIN_LENGTH_M:g} m apart")
    return build_route(network, lanes, start[1], goal[1])


def _place(network: RoadNetwork, mission: Mission, what: str, place: Place) -> tuple[int, float]:
    lane = network.lane_index.get(place.lane)
    if lane is None:
        raise InvalidInputError(
            f"mission '{mission.name}': network '{network.name}' has no lane '{place.lane}' ({what})"
        )
    if not network.lanes.drivable[lane]:
        raise InvalidInputError(f"mission '{mission.name}': {what} lane '{place.lane}' is closed to passenger cars")
    length = float(network.lanes.length[lane])
    position = place.position_m if place.position_m >= 0 else place.position_m + length
    if not 0 <= position <= length:
        raise InvalidInputError(
            f"mission '{mission.name}': {what} at {place.position_m} m is off lane '{place.lane}', {length:.1f} m long"
        )
    return lane, position


def _via(network: RoadNetwork, mission: Mission, edge: str) -> int:
    for lane in network.lanes_of_edge.get(edge, []):
        if network.lanes.drivable[lane]:
            return int(network.lanes.edge[lane])
    raise InvalidInputError(f"mission '{mission.name}': network '{network.name}' has no drivable edge '{edge}' (via)")


# Lane, position at which the search entered it, and number of via edges passed. Lanes beside the start are entered at
# the start's position, all others at their beginning, so that a round trip may come back to the start lane.
_Node = tuple[int, float, int]


def _search(
    network: RoadNetwork, start: int, start_at: float, goal: int, goal_at: float, via: list[int]
) -> list[int] | None:
    """A* over lanes: a connection costs the lane's travel time, a lane change a fixed time."""
    lanes, fastest = network.lanes, _fastest(network)
    gx, gy = network.lane_shape(goal)[0]

    def remaining(lane: int, at: float) -> float:
        if at > 0.0:
            return 0.0
        x, y = network.lane_shape(lane)[0]
        return math.hypot(gx - x, gy - y) / fastest

    def node(lane: int, at: float, passed: int) -> _Node:
        while passed < len(via) and lanes.edge[lane] == via[passed]:
            passed += 1
        return lane, at, passed

    frontier: list[tuple[float, int, float, _Node, _Node | None]] = [(0.0, 0, 0.0, node(start, start_at, 0), None)]
    came_from: dict[_Node, _Node | None] = {}
    pushed = 0
    while frontier:
        _, _, cost, here, parent = heapq.heappop(frontier)
        if here in came_from:
            continue
        came_from[here] = parent
        lane, at, passed = here
        if lane == goal and goal_at >= at and passed == len(via):
            return _unwind(came_from, here)
        arriving = passed == len(via) and lanes.edge[lane] == lanes.edge[goal] and goal_at >= at
        for following, is_change, step in _moves(network, lane, at, goal_at if arriving else math.inf):
            child = node(following, at if is_change else 0.0, passed)
            if child not in came_from:
                pushed += 1
                total = cost + step
                heapq.heappush(frontier, (total + remaining(*child[:2]), pushed, total, child, here))
    return None


def _fastest(network: RoadNetwork) -> float:
    """Largest straight-line distance per cost of any connection, m/s, so that A* never overestimates.

    The value is a little above the highest limit, since the length that SUMO gives a lane may be less than its shape's.
    """
    lanes, connections = network.lanes, network.connections
    drivable = lanes.drivable[connections.source] & lanes.drivable[connections.target]
    source, target = connections.source[drivable], connections.target[drivable]
    begin = lanes.points[lanes.start[:-1]]
    beeline = np.hypot(*(begin[target] - begin[source]).T)
    return float((beeline * lanes.speed[source] / lanes.length[source]).max(initial=1.0))


def _unwind(came_from: dict[_Node, _Node | None], node: _Node) -> list[int]:
    path = [node[0]]
    while (parent := came_from[node]) is not None:
        path.append(parent[0])
        node = parent
    return path[::-1]


def _moves(network: RoadNetwork, lane: int, entered_at: float, change_before: float) -> list[tuple[int, bool, float]]:
    """Next lanes of a lane, each with its cost in seconds and whether it takes a lane change."""
    lanes, moves = network.lanes, []
    length = float(lanes.length[lane])
    room = min(length, change_before) - entered_at
    travel = (length - entered_at) / float(lanes.speed[lane])
    for c in network.connections_from(lane):
        target = int(network.connections.target[c])
        if lanes.drivable[target]:
            turn = TURNAROUND_COST_S if network.connections.direction[c] == "t" else 0.0
            moves.append((target, False, travel + turn))
    for neighbour in (int(lanes.left[lane]), int(lanes.right[lane])):
        if neighbour >= 0:
            cost = LANE_CHANGE_COST_S if room >= MIN_LANE_CHANGE_M else SHORT_LANE_CHANGE_COST_S
            moves.append((neighbour, True, cost))
    return moves
