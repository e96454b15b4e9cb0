"""Buildings: plain boxes set back from the roads, generated from the network only, without maps of real buildings."""

from __future__ import annotations

import zlib
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.geometry import boxes_overlap
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.portable_math import arctan2
from dohyo.sumo_networks.rendering.surfaces import LONGEST_M, CellIndex, ground_of

BLOCK_M = 256.0
BLOCKS = 256
PITCH_M = 26.0
LARGEST_M = 30.0
CLEARANCE_M = 1.5
FLOOR_M = 3.1
COLUMNS = 7


def buildings_near(network: RoadNetwork, x: float, y: float, radius: float) -> FloatArray:
    """(B, 7) x, y [m], heading [rad], length, depth, height [m], and a number in [0, 1) for the colour.

    The result has all buildings whose centre is within a radius [m], and some beyond.
    """
    columns, rows = (range(int((at - radius) // BLOCK_M), int((at + radius) // BLOCK_M) + 1) for at in (x, y))
    return np.concatenate([_block(network, column, row) for column in columns for row in rows])


@lru_cache(maxsize=BLOCKS)
def _block(network: RoadNetwork, column: int, row: int) -> FloatArray:
    """The buildings of one square of 256 m.

    A candidate is kept if it overlaps no paved area and no other such candidate of higher priority; so the result
    does not depend on the order in which squares are computed.
    """
    candidates, priority, cells = _candidates(network)
    x0, y0 = column * BLOCK_M, row * BLOCK_M
    near = cells.near(x0, y0, x0 + BLOCK_M, y0 + BLOCK_M, 2 * LARGEST_M)
    boxes, rank = candidates[near], priority[near]
    if not len(boxes):
        return np.empty((0, COLUMNS))
    clear = _clear(network, boxes, x0, y0)
    boxes, rank = boxes[clear], rank[clear]
    grown = boxes[:, :5] + (0.0, 0.0, 0.0, CLEARANCE_M, CLEARANCE_M)
    beaten = (boxes_overlap(grown, grown) & (rank[:, None] < rank[None, :])).any(axis=1)
    inside = (boxes[:, :2] >= (x0, y0)).all(axis=1) & (boxes[:, :2] < (x0 + BLOCK_M, y0 + BLOCK_M)).all(axis=1)
    return boxes[~beaten & inside]


def _clear(network: RoadNetwork, boxes: FloatArray, x0: float, y0: float) -> BoolArray:
    """(B,) whether every paved area is at least 1.5 m away."""
    ground = ground_of(network)
    reach = 3 * LARGEST_M
    x1, y1 = x0 + BLOCK_M + reach, y0 + BLOCK_M + reach
    near = ground.cells.near(x0 - reach, y0 - reach, x1, y1, LONGEST_M)
    bounds = ground.outline_bounds
    overlaps = (bounds[:, 0] < x1) & (bounds[:, 2] > x0 - reach) & (bounds[:, 1] < y1) & (bounds[:, 3] > y0 - reach)
    paved = list(shapely.polygons(ground.quads[near].astype(np.float64)))
    paved += [shapely.polygons(ground.outlines[i]) for i in np.flatnonzero(overlaps)]
    taken = shapely.STRtree(paved).query(shapely.polygons(_corners(boxes, CLEARANCE_M)), predicate="intersects")[0]
    out = np.ones(len(boxes), dtype=np.bool_)
    out[taken] = False
    return out


def _corners(boxes: FloatArray, margin: float) -> FloatArray:
    """(B, 4, 2) corners, m."""
    cos, sin = np.cos(boxes[:, 2]), np.sin(boxes[:, 2])
    along = np.column_stack([cos, sin]) * (boxes[:, 3] / 2 + margin)[:, None]
    across = np.column_stack([-sin, cos]) * (boxes[:, 4] / 2 + margin)[:, None]
    return boxes[:, None, :2] + np.stack([-along - across, along - across, along + across, -along + across], axis=1)


@lru_cache(maxsize=4)
def _candidates(network: RoadNetwork) -> tuple[FloatArray, FloatArray, CellIndex]:
    """Candidate buildings along both sides of every street, their priorities in [0, 1), and the index by cell."""
    rows = np.concatenate([_along(network, side) for side in (-1.0, 1.0)])
    cells = CellIndex(rows[:, :2])
    rows = rows[cells.order]
    return rows[:, :COLUMNS], rows[:, COLUMNS], cells


def _along(network: RoadNetwork, side: float) -> FloatArray:
    """(C, 8) candidates on one side (1 left) of the streets."""
    lanes = network.lanes
    outermost = lanes.drivable & ~lanes.internal & ((lanes.right if side < 0 else lanes.left) < 0)
    lane = np.flatnonzero(outermost)
    first, last = lanes.start[lane], lanes.start[lane + 1] - 1
    step = np.hypot(*np.diff(lanes.points, axis=0).T)
    arc = np.concatenate([[0.0], np.cumsum(step)])
    length = arc[last] - arc[first]
    count = np.floor(length / PITCH_M + 0.4).astype(np.int64)
    number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    which = np.repeat(np.arange(len(lane)), count)
    pitch = (length / np.maximum(count, 1))[which]
    seed = np.array([zlib.crc32(str(name).encode()) for name in lanes.ids[lane]], dtype=np.uint64)[which]
    draw = [_hash(seed, number.astype(np.uint64), salt + (10 if side > 0 else 0)) for salt in range(6)]
    at = arc[first][which] + (number + 0.5) * pitch
    segment = np.clip(np.searchsorted(arc, at, side="right") - 1, first[which], last[which] - 1)
    vector = lanes.points[segment + 1] - lanes.points[segment]
    heading = arctan2(vector[:, 1], vector[:, 0])
    share = (at - arc[segment]) / np.maximum(step[segment], 1e-9)
    size = np.minimum(pitch * (0.62 + 0.34 * draw[0]), LARGEST_M)
    depth = 10.0 + 5.0 * draw[1]
    height = FLOOR_M * np.floor(2.0 + 4.0 * draw[2] * np.sqrt(draw[2])) + 0.8
    aside = _verge(network, lane, side)[which] + 4.0 + 3.0 * draw[3] + depth / 2
    normal = np.column_stack([-np.sin(heading), np.cos(heading)]) * side
    centre = lanes.points[segment] + vector * share[:, None] + normal * aside[:, None]
    return np.column_stack([centre, heading, size, depth, height, draw[4], draw[5]])


def _verge(network: RoadNetwork, lane: IntArray, side: float) -> FloatArray:
    """Distance from each lane's centreline to the outer edge of its street on one side, m."""
    lanes = network.lanes
    out = np.empty(len(lane))
    for row, one in enumerate(lane.tolist()):
        beside = np.array(network.lanes_of_edge[network.edge_id(one)])
        outer = beside[(lanes.index[beside] - lanes.index[one]) * side > 0]
        out[row] = lanes.width[one] / 2 + lanes.width[outer].sum()
    return out


def _hash(seed: NDArray[np.uint64], number: NDArray[np.uint64], salt: int) -> FloatArray:
    """Pseudo-random numbers in [0, 1), the same on every machine (splitmix64's mixing)."""
    with np.errstate(over="ignore"):
        z: NDArray[np.uint64] = (
            seed * np.uint64(0x9E3779B97F4A7C15) + number * np.uint64(0xBF58476D1CE4E5B9) + np.uint64(salt * 7919 + 1)
        )
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    return np.asarray((z >> np.uint64(11)).astype(np.float64) / 2.0**53)
