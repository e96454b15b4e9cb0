"""Paths: the lines along which scripted actors move."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.portable_math import arctan2

if TYPE_CHECKING:  # scenarios are read without roads, whose numeric kernels take long to import
    from dohyo.sumo_networks.networks.network import RoadNetwork

SPACING_M = 1.0
MEETING_M = 1.0
CHORD_M = 6


class ActorPath:
    """A polyline by arc length, extended straight before its start and past its end.

    Attributes:
        points: (N, 2), m, network frame, about 1 m apart.
        arc: (N,), m, arc length of each point.
        length: Length of the polyline, m.
    """

    def __init__(self, points: FloatArray) -> None:
        steps = np.hypot(*np.diff(points, axis=0).T)
        points = points[np.concatenate([[True], steps > 1e-6])]
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        count = max(round(float(along[-1]) / SPACING_M), 1) + 1
        self.arc: FloatArray = np.linspace(0.0, along[-1], count)
        self.points: FloatArray = np.column_stack([np.interp(self.arc, along, points[:, i]) for i in (0, 1)])
        self.length = float(along[-1])
        step = np.gradient(self.points, axis=0)
        self._heading = np.unwrap(arctan2(step[:, 1], step[:, 0]))

    def at(self, s: float, left: float = 0.0) -> tuple[float, float, float]:
        """A point beside the path.

        Args:
            s: Arc length, m.
            left: Distance to the left of the path, m.

        Returns:
            x [m], y [m], direction of the path [rad].
        """
        heading = float(np.interp(s, self.arc, self._heading))
        x, y = (float(np.interp(s, self.arc, self.points[:, i])) for i in (0, 1))
        beyond = s - min(max(s, 0.0), self.length)
        x += beyond * math.cos(heading) - left * math.sin(heading)
        y += beyond * math.sin(heading) + left * math.cos(heading)
        return x, y, wrapped(heading)

    def curvature(self, first_m: float, last_m: float) -> float:
        """Largest curvature of a part of the path, 1/m; measured over 6 m, since lanes are drawn with corners."""
        heading = np.interp(np.arange(max(first_m, 0.0), min(last_m, self.length)), self.arc, self._heading)
        return float(np.abs(heading[CHORD_M:] - heading[:-CHORD_M]).max(initial=0.0)) / CHORD_M

    def project(self, points: FloatArray, first_m: float, last_m: float) -> tuple[FloatArray, FloatArray]:
        """Projects points on a part of the path.

        Args:
            points: (M, 2), m, network frame.
            first_m: Arc length of the part's start, m.
            last_m: Arc length of the part's end, m.

        Returns:
            (M,) arc length [m] and (M,) signed distance [m, left positive] of the nearest point of the path.
        """
        spacing = self.length / (len(self.arc) - 1)
        low = int(min(max(first_m / spacing, 0), len(self.arc) - 2))
        high = math.ceil(min(max(last_m / spacing + 1, low + 2), len(self.arc)))
        part = self.points[low:high]
        nearest = np.argmin(((points[:, None] - part) ** 2).sum(axis=2), axis=1)
        heading = self._heading[low + nearest]
        dx, dy = (points - part[nearest]).T
        cos, sin = np.cos(heading), np.sin(heading)
        return self.arc[low + nearest] + dx * cos + dy * sin, dy * cos - dx * sin


def wrapped(angle: float) -> float:
    """Angle brought into [-pi, pi), rad: `geometry.wrap` in plain Python."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def lane_path(network: RoadNetwork, lanes: Sequence[int]) -> ActorPath:
    """Path along connected lanes."""
    return ActorPath(np.concatenate([network.lane_shape(lane) for lane in lanes]))


def upstream(network: RoadNetwork, lane: int, length_m: float) -> list[int]:
    """A lane and the lanes before it, straight on if possible, up to a length or to the road's beginning."""
    lanes, connections = network.lanes, network.connections
    found, metres = [lane], float(lanes.length[lane])
    while metres < length_m:
        into = np.flatnonzero(connections.target == found[0])
        into = into[lanes.drivable[connections.source[into]] & (connections.direction[into] != "t")]
        into = into[[int(connections.source[c]) not in found for c in into]]
        if not len(into):
            break
        straight = [int(c) for c in into if _is_straight(network, int(c))]
        found.insert(0, int(connections.source[straight[0] if straight else into[0]]))
        metres += float(lanes.length[found[0]])
    return found


def downstream(network: RoadNetwork, lane: int, length_m: float) -> list[int]:
    """A lane and the lanes after it, straight on if possible, up to a length or to the road's end."""
    lanes, connections = network.lanes, network.connections
    found, metres = [lane], float(lanes.length[lane])
    while metres < length_m:
        out = [
            c
            for c in network.connections_from(found[-1])
            if lanes.drivable[connections.target[c]]
            and connections.direction[c] != "t"
            and int(connections.target[c]) not in found
        ]
        if not out:
            break
        straight = [c for c in out if connections.direction[c] == "s"]
        found.append(int(connections.target[straight[0] if straight else out[0]]))
        metres += float(lanes.length[found[-1]])
    return found


def _is_straight(network: RoadNetwork, connection: int) -> bool:
    """Whether a connection goes straight on; inside a junction, the direction at its beginning decides."""
    connections = network.connections
    while connections.direction[connection] == "i":
        before = np.flatnonzero(connections.target == connections.source[connection])
        if not len(before):
            return False
        connection = int(before[0])
    return bool(connections.direction[connection] == "s")


def edges_of(network: RoadNetwork, lanes: Sequence[int]) -> tuple[str, ...]:
    """Edges of connected lanes, without edges inside junctions: a route for SUMO."""
    return tuple(dict.fromkeys(network.edge_id(lane) for lane in lanes if not network.lanes.internal[lane]))


def meeting(a: ActorPath, a_from: float, a_to: float, b: ActorPath) -> tuple[float, float] | None:
    """First place where a part of one path is within 1 m of another path: arc lengths on both [m], or None."""
    rows = np.flatnonzero((a.arc >= a_from) & (a.arc <= a_to))
    if not len(rows):
        return None
    distance = np.hypot(*(a.points[rows, None] - b.points).transpose(2, 0, 1))
    near = np.flatnonzero(distance.min(axis=1) < MEETING_M)
    if not len(near):
        return None
    row = int(near[0])
    return float(a.arc[rows[row]]), float(b.arc[int(distance[row].argmin())])
