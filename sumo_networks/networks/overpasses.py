"""Overpasses: places where two roads cross without a junction, as at a bridge; here both roads lie in one plane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.networks.connectivity import junctions_of_edges
from dohyo.sumo_networks.networks.network import RoadNetwork

MIN_ANGLE = np.radians(10.0)
"""Least angle between two lanes that cross: lanes side by side may touch at a smaller one."""
JUNCTION_REACH_M = 10.0
"""Distance from the outline of a junction up to which its own lanes may cross."""


@dataclass(frozen=True, slots=True)
class Overpasses:
    """P places where two drivable lanes cross without a junction.

    Attributes:
        lanes: (P, 2) the two lanes.
        points: (P, 2), m, network frame.
        angles: (P,), rad, between the directions of the two lanes, from 0 to pi / 2.
    """

    lanes: IntArray
    points: FloatArray
    angles: FloatArray


@lru_cache(maxsize=8)
def find_overpasses(network: RoadNetwork) -> Overpasses:
    """Finds where drivable lanes cross that meet at no junction, or far from the junctions where they meet.

    Lanes of one edge, and of edges between the same two junctions, are not looked at.
    """
    lane, begin, step = _segments(network)
    one, other = _crossing_pairs(begin, step)
    junctions = junctions_of_edges(network)[network.lanes.edge[lane]]
    apart = network.lanes.edge[lane[one]] != network.lanes.edge[lane[other]]
    apart &= (np.sort(junctions[one], axis=1) != np.sort(junctions[other], axis=1)).any(axis=1)
    one, other = one[apart], other[apart]
    across = _cross(step[one], step[other])
    lengths = np.hypot(*step[one].T) * np.hypot(*step[other].T)
    points = begin[one] + step[one] * (_cross(begin[other] - begin[one], step[other]) / across)[:, None]
    angles = np.arcsin(np.clip(np.abs(across) / lengths, 0.0, 1.0))
    found = (angles >= MIN_ANGLE) & ~_at_common_junction(network, points, junctions[one], junctions[other])
    lanes = np.column_stack([lane[one], lane[other]])[found]
    return Overpasses(lanes, points[found], angles[found])


def _segments(network: RoadNetwork) -> tuple[IntArray, FloatArray, FloatArray]:
    """(S,) lane, (S, 2) first point and (S, 2) step of each segment of the drivable lanes' centrelines."""
    lanes = network.lanes
    owner = np.repeat(np.arange(len(lanes.ids)), np.diff(lanes.start))
    step = np.diff(lanes.points, axis=0)
    kept = (owner[:-1] == owner[1:]) & lanes.drivable[owner[:-1]] & (np.hypot(step[:, 0], step[:, 1]) > 1e-6)
    return owner[:-1][kept], lanes.points[:-1][kept], step[kept]


def _crossing_pairs(begin: FloatArray, step: FloatArray) -> tuple[IntArray, IntArray]:
    """Rows of segments that share a point and are not parallel, each pair once."""
    lines = shapely.linestrings(np.stack([begin, begin + step], axis=1))
    one, other = shapely.STRtree(lines).query(lines, predicate="intersects")
    kept = (one < other) & (np.abs(_cross(step[one], step[other])) > 1e-9)
    return one[kept], other[kept]


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    crossed: FloatArray = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return crossed


def _at_common_junction(network: RoadNetwork, points: FloatArray, one: IntArray, other: IntArray) -> np.ndarray:
    """(N,) whether a point lies at a junction of both lanes; (N, 2) junctions of each, -1 where there is none."""
    outlines = [network.junction_shape(junction) for junction in range(len(network.junctions.ids))]
    hulls = np.array([shapely.convex_hull(shapely.multipoints(shape)) for shape in outlines], dtype=object)
    near = np.zeros(len(points), dtype=np.bool_)
    for a in (0, 1):
        for b in (0, 1):
            rows = np.flatnonzero((one[:, a] == other[:, b]) & (one[:, a] >= 0))
            away = shapely.distance(shapely.points(points[rows]), hulls[one[rows, a]])
            near[rows] |= ~(away > JUNCTION_REACH_M)  # one without an outline has no distance
    return near
