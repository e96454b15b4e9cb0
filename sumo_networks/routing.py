"""Route: the lane-level reference path of a mission, and the A* search over lanes that finds it."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise

import numpy as np

from sumo_networks.arrays import BoolArray, FloatArray, IntArray
from sumo_networks.errors import InvalidInputError
from sumo_networks.geometry import project_on_path
from sumo_networks.network import RoadNetwork
from sumo_networks.scenario import Mission, Place

SPACING_M = 1.0
MIN_LENGTH_M = 2.0
LANE_CHANGE_COST_S = 5.0
SHORT_LANE_CHANGE_COST_S = 60.0
MIN_LANE_CHANGE_M = 20.0
LANE_CHANGE_LENGTH_M = 35.0
TURNAROUND_COST_S = 60.0
COMMAND_LEAD_M = 30.0
SMOOTHING_M = 1.5


class Command(IntEnum):
    """What the navigation says: the next manoeuvre within 30 m, or FOLLOW."""

    FOLLOW = 0
    LEFT = 1
    RIGHT = 2
    STRAIGHT = 3
    CHANGE_LEFT = 4
    CHANGE_RIGHT = 5


_TURNS = {"l": Command.LEFT, "L": Command.LEFT, "t": Command.LEFT, "r": Command.RIGHT, "R": Command.RIGHT}


@dataclass(frozen=True, slots=True)
class Passage:
    """One passage of the route through a junction.

    Attributes:
        entry: m along the route, where the junction begins (the stop line, where there is one).
        exit: m along the route, where it ends.
        connection: The connection taken, index into `RoadNetwork.connections`.
        signal: The signal that controls it, -1 if none.
        control: SUMO's letter for the right of way.
        command: LEFT, RIGHT or STRAIGHT.
    """

    entry: float
    exit: float
    connection: int
    signal: int
    control: str
    command: Command


@dataclass(frozen=True, slots=True)
class LaneChange:
    """One lane change of the route.

    Attributes:
        start: m along the route, where the path begins to leave its lane.
        end: m along the route, where it is in the new lane.
        command: CHANGE_LEFT or CHANGE_RIGHT.
    """

    start: float
    end: float
    command: Command


@dataclass(frozen=True)
class Route:
    """The lane-level reference path of a mission, a point every metre.

    Attributes:
        length: m.
        position: (N, 2), m, network frame.
        heading: (N,), rad.
        curvature: (N,), 1/m, left positive.
        speed_limit: (N,), m/s.
        width: (N,), m, of the lane there.
        lane: (N,) lane the path is on; at a lane change the nearer one.
        command: (N,) Command that the navigation gives there.
        passages: Junctions in order.
        lane_changes: In order.
        edges: SUMO edge ids (without internal ones), for SUMO's own route of the ego.
        on_route: (L,) lanes the route uses.
    """

    length: float
    position: FloatArray
    heading: FloatArray
    curvature: FloatArray
    speed_limit: FloatArray
    width: FloatArray
    lane: IntArray
    command: IntArray
    passages: tuple[Passage, ...]
    lane_changes: tuple[LaneChange, ...]
    edges: tuple[str, ...]
    on_route: BoolArray

    def project(
        self, x: float, y: float, near: float, behind: float = 10.0, ahead: float = 30.0
    ) -> tuple[float, float, float]:
        """Projects a point on the part of the route around an arc length.

        Args:
            x: m.
            y: m.
            near: Arc length around which to search, m.
            behind: How far back to search, m.
            ahead: How far ahead to search, m.

        Returns:
            Arc length [m], signed distance [m, left positive], direction of the route there [rad].
        """
        spacing = self.length / (len(self.position) - 1)
        first = int((near - behind) / spacing)
        last = math.ceil((near + ahead) / spacing) + 1
        return project_on_path(x, y, self.position, spacing, first, last)

    def index(self, s: float) -> int:
        """Row of the path point nearest to an arc length, m."""
        last = len(self.position) - 1
        return min(max(round(s * last / self.length), 0), last)


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
    return _PathBuilder(network, lanes, start[1], goal[1]).build()


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


# A lane, where on it the search came, and how many of the via edges are behind it. Lanes beside the start are reached
# part of the way along; all others at their beginning, so that a round trip may come back to the start lane.
_Node = tuple[int, float, int]


def _search(
    network: RoadNetwork, start: int, start_at: float, goal: int, goal_at: float, via: list[int]
) -> list[int] | None:
    """A* over lanes: following a connection costs the lane's travel time, a lane change a fixed time."""
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
    """Most metres of bee-line per second of cost along any connection, so that A* never overestimates, m/s.

    A little above the highest limit, since SUMO's lanes may be shorter than they are drawn.
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
    """Lanes reachable from a lane: which, whether by a lane change, and at what cost in seconds."""
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


class _PathBuilder:
    """Joins the centrelines of a lane sequence into one smooth path."""

    def __init__(self, network: RoadNetwork, lanes: list[int], start: float, goal: float) -> None:
        self.network, self.start, self.goal = network, start, goal
        self.runs = _runs(network, lanes)
        self.points: list[FloatArray] = []
        self.owner: list[IntArray] = []
        self.entered: list[int] = []

    def build(self) -> Route:
        changes: list[tuple[int, int, Command]] = []
        for number, run in enumerate(self.runs):
            first = self._fraction(run[0], self.start) if number == 0 else 0.0
            last = self._fraction(run[-1], self.goal) if number == len(self.runs) - 1 else 1.0
            begin = sum(map(len, self.points))
            self.entered.append(begin)
            points, owner, blends = _blend(self.network, run, first, last)
            self.points.append(points)
            self.owner.append(owner)
            changes += [(begin + a, begin + b, command) for a, b, command in blends]
        raw, owner = np.concatenate(self.points), np.concatenate(self.owner)
        return self._resample(raw, owner, _arc_lengths(raw), changes)

    def _fraction(self, lane: int, position: float) -> float:
        return position / float(self.network.lanes.length[lane])

    def _resample(
        self, raw: FloatArray, owner: IntArray, arc: FloatArray, changes: list[tuple[int, int, Command]]
    ) -> Route:
        count = max(round(arc[-1] / SPACING_M), 1) + 1
        at = np.linspace(0.0, arc[-1], count)
        keep = np.concatenate([[True], np.diff(arc) > 1e-9])
        position = np.column_stack([np.interp(at, arc[keep], raw[keep, i]) for i in (0, 1)])
        smooth = _smooth(position)
        along = _arc_lengths(smooth)
        even = np.linspace(0.0, along[-1], count)
        position = np.column_stack([np.interp(even, along, smooth[:, i]) for i in (0, 1)])
        length = float(_arc_lengths(position)[-1])
        # Smoothing cuts corners: arc lengths shrink there, and nowhere else.
        arc_on_path = np.interp(arc, at, along) * length / along[-1]
        lane = owner[np.clip(np.searchsorted(arc, np.interp(even, along, at), side="right") - 1, 0, len(owner) - 1)]
        passages = self._passages(arc_on_path, length)
        lane_changes = tuple(
            LaneChange(float(arc_on_path[a]), float(arc_on_path[b]), command) for a, b, command in changes
        )
        heading, curvature = _directions(position)
        lanes = self.network.lanes
        on_route = np.zeros(len(lanes.ids), dtype=np.bool_)
        on_route[[i for run in self.runs for i in run]] = True
        return Route(
            length=length,
            position=position,
            heading=heading,
            curvature=curvature,
            speed_limit=lanes.speed[lane],
            width=lanes.width[lane],
            lane=lane,
            command=_commands(np.linspace(0.0, length, count), passages, lane_changes),
            passages=passages,
            lane_changes=lane_changes,
            edges=self._edges(),
            on_route=on_route,
        )

    def _edges(self) -> tuple[str, ...]:
        return tuple(self.network.edge_id(run[0]) for run in self.runs if not self.network.lanes.internal[run[0]])

    def _passages(self, arc: FloatArray, length: float) -> tuple[Passage, ...]:
        out = []
        for number, (run, following) in enumerate(pairwise(self.runs)):
            if self.network.lanes.internal[run[-1]]:
                continue
            c = _connection(self.network, run[-1], following[0])
            leave = number + 1
            while leave < len(self.runs) and self.network.lanes.internal[self.runs[leave][0]]:
                leave += 1
            out.append(
                Passage(
                    entry=float(arc[self.entered[number + 1]]),
                    exit=float(arc[self.entered[leave]]) if leave < len(self.runs) else length,
                    connection=c,
                    signal=int(self.network.connections.signal[c]),
                    control=str(self.network.connections.control[c]),
                    command=_TURNS.get(str(self.network.connections.direction[c]), Command.STRAIGHT),
                )
            )
        return tuple(out)


def _runs(network: RoadNetwork, lanes: list[int]) -> list[list[int]]:
    """Groups consecutive lanes that are reached by lane changes."""
    runs = [[lanes[0]]]
    for a, b in pairwise(lanes):
        if b in (network.lanes.left[a], network.lanes.right[a]):
            runs[-1].append(b)
        else:
            runs.append([b])
    return runs


def _blend(
    network: RoadNetwork, run: list[int], first: float, last: float
) -> tuple[FloatArray, IntArray, list[tuple[int, int, Command]]]:
    """Points along a run of neighbouring lanes, changing from each to the next by a smooth step.

    Returns:
        (P, 2) points, (P,) lane of each, and per lane change its first and last point and its command.
    """
    span = float(network.lanes.length[run[0]]) * (last - first)
    count = max(math.ceil(span / 0.5), 1) + 1
    fraction = np.linspace(first, last, count)
    shapes = [_at_fractions(network.lane_shape(lane), fraction) for lane in run]
    points, owner = shapes[0], np.full(count, run[0])
    blends: list[tuple[int, int, Command]] = []
    half = 0.5 * min(LANE_CHANGE_LENGTH_M, 0.8 * span / max(len(run) - 1, 1)) / max(span, 1e-9)
    half = max(half, 1e-9)
    for number, (a, b) in enumerate(pairwise(run)):
        middle = (number + 1) / len(run)
        t = np.clip((np.linspace(0.0, 1.0, count) - middle + half) / (2 * half), 0.0, 1.0)
        weight = (t * t * (3 - 2 * t))[:, None]
        points = points * (1 - weight) + shapes[number + 1] * weight
        owner = np.where(t > 0.5, b, owner)
        command = Command.CHANGE_LEFT if network.lanes.left[a] == b else Command.CHANGE_RIGHT
        blends.append((int(np.argmax(t > 0)), int(np.argmax(t >= 1)) if t[-1] >= 1 else count - 1, command))
    return points, owner, blends


def _at_fractions(shape: FloatArray, fraction: FloatArray) -> FloatArray:
    arc = _arc_lengths(shape)
    return np.column_stack([np.interp(fraction * arc[-1], arc, shape[:, i]) for i in (0, 1)])


def _smooth(position: FloatArray) -> FloatArray:
    """Rounds the kinks between lanes by a Gaussian of 1.5 m, keeping both ends."""
    reach = int(3 * SMOOTHING_M / SPACING_M)
    if len(position) < 3:
        return position
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * SPACING_M / SMOOTHING_M) ** 2)
    kernel /= kernel.sum()
    before = 2 * position[0] - position[np.clip(np.arange(reach, 0, -1), 0, len(position) - 1)]
    after = 2 * position[-1] - position[np.clip(len(position) - 2 - np.arange(reach), 0, len(position) - 1)]
    padded = np.concatenate([before, position, after])
    smooth = np.column_stack([np.convolve(padded[:, i], kernel, mode="valid") for i in (0, 1)])
    smooth[0], smooth[-1] = position[0], position[-1]
    return smooth


def _arc_lengths(points: FloatArray) -> FloatArray:
    """(N,) distance of every point from the first, along the line, m."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])


def _directions(position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N,) heading [rad] and (N,) curvature [1/m] of an equally spaced path."""
    step = np.gradient(position, axis=0)
    heading = np.arctan2(step[:, 1], step[:, 0])
    spacing = float(np.hypot(*np.diff(position, axis=0).T).mean())
    curvature = np.gradient(np.unwrap(heading), spacing)
    return heading, curvature


def _connection(network: RoadNetwork, source: int, target: int) -> int:
    return next(c for c in network.connections_from(source) if network.connections.target[c] == target)


def _commands(at: FloatArray, passages: tuple[Passage, ...], lane_changes: tuple[LaneChange, ...]) -> IntArray:
    command = np.full(len(at), Command.FOLLOW, dtype=np.int64)
    for passage in reversed(passages):
        command[(at >= passage.entry - COMMAND_LEAD_M) & (at <= passage.exit)] = passage.command
    for change in reversed(lane_changes):
        command[(at >= change.start - COMMAND_LEAD_M) & (at <= change.end)] = change.command
    return command
