"""Route: the lane-level reference path of a mission, built as one smooth path from a sequence of lanes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.geometry import project_on_path
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.portable_math import arctan2
from dohyo.sumo_networks.routes.command import Command

SPACING_M = 1.0
LANE_CHANGE_LENGTH_M = 35.0
COMMAND_LEAD_M = 30.0
SMOOTHING_M = 1.5

_TURNS = {"l": Command.LEFT, "L": Command.LEFT, "t": Command.LEFT, "r": Command.RIGHT, "R": Command.RIGHT}


@dataclass(frozen=True, slots=True)
class Passage:
    """One passage of the route through a junction.

    Attributes:
        entry: Arc length at which the junction begins (at its stop line, if there is one), m.
        exit: Arc length at which the junction ends, m.
        connection: Index of the route's connection in `RoadNetwork.connections`.
        signal: Index of the signal that controls the connection, -1 if none.
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
        start: Arc length at which the path begins to leave its lane, m.
        end: Arc length at which the path is in the new lane, m.
        command: CHANGE_LEFT or CHANGE_RIGHT.
    """

    start: float
    end: float
    command: Command


@dataclass(frozen=True)
class Route:
    """The lane-level reference path of a mission, a point every metre.

    Attributes:
        length: Length of the route, m.
        position: (N, 2), m, network frame.
        heading: (N,), rad.
        curvature: (N,), 1/m, left positive.
        speed_limit: (N,), m/s.
        width: (N,), m, width of the lane.
        lane: (N,) lane under the path; at a lane change the nearer lane.
        command: (N,) Command of the navigation.
        passages: Passages through junctions, in driving order.
        lane_changes: Lane changes, in driving order.
        edges: SUMO edge ids (without internal ones), for SUMO's own route of the ego.
        on_route: (L,) whether the route uses the lane.
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

    @cached_property
    def table(self) -> FloatArray:
        """(N, 7) x, y, heading, curvature, speed limit, width and command of every point, in the units above."""
        columns = self.position, self.heading, self.curvature, self.speed_limit, self.width, self.command
        return np.column_stack(columns).astype(np.float64)

    def project(
        self, x: float, y: float, near: float, behind: float = 10.0, ahead: float = 30.0
    ) -> tuple[float, float, float]:
        """Projects a point on the part of the route around an arc length.

        Args:
            x: x of the point, m.
            y: y of the point, m.
            near: Arc length around which to search, m.
            behind: Length of the search backwards, m.
            ahead: Length of the search forwards, m.

        Returns:
            Arc length [m], signed distance [m, left positive], direction of the route at that point [rad].
        """
        spacing = self.length / (len(self.position) - 1)
        first = int((near - behind) / spacing)
        last = math.ceil((near + ahead) / spacing) + 1
        return project_on_path(x, y, self.position, spacing, first, last)

    def index(self, s: float) -> int:
        """Row of the path point nearest to an arc length, m."""
        last = len(self.position) - 1
        return min(max(round(s * last / self.length), 0), last)


def build_route(network: RoadNetwork, lanes: list[int], start: float, goal: float) -> Route:
    """Builds the route along lanes, each of which leads into the next or lies beside it.

    Args:
        network: The network of the lanes.
        lanes: Rows of the lanes in the network, in driving order.
        start: Position along the first lane, m.
        goal: Position along the last lane, m.
    """
    return _PathBuilder(network, lanes, start, goal).build()


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
        # Smoothing cuts corners: arc lengths shrink at corners only.
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
    heading = arctan2(step[:, 1], step[:, 0])
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
