"""Network map: the roads around a place as plain JSON, for a replay to draw."""

from __future__ import annotations

import gzip
import json
from functools import lru_cache
from typing import Any

import numpy as np

from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork

Box = tuple[float, float, float, float]
KEPT = 16


def map_document(network: RoadNetwork, box: Box | None = None) -> dict[str, Any]:
    """Lanes, junctions and stop lines.

    Args:
        network: Network to draw.
        box: x0, y0, x1, y1, m: limits the answer to objects that reach into it; None: everything.

    Returns:
        `lanes`: points [m], width [m], kind (drive, bicycle, walk, crossing, internal); `junctions`: outlines [m];
        `stop_lines`: x1, y1, x2, y2 [m]. Rounded to centimetres.
    """
    lanes, junctions, lines = network.lanes, network.junctions, network.stop_lines.segment
    kinds = _kinds(network)
    near_lanes = _near(lanes.points, lanes.start, box)
    near_junctions = _near(junctions.points, junctions.start, box)
    ends = np.arange(0, 2 * len(lines) + 1, 2)
    near_lines = _near(lines.reshape(-1, 2), ends, box)
    return {
        "lanes": [
            {"points": _rounded(network.lane_shape(i)), "width": round(float(lanes.width[i]), 2), "kind": kinds[i]}
            for i in np.flatnonzero(near_lanes).tolist()
            if kinds[i]
        ],
        "junctions": [
            _rounded(network.junction_shape(j))
            for j in np.flatnonzero(near_junctions).tolist()
            if junctions.start[j + 1] - junctions.start[j] >= 3
        ],
        "stop_lines": _rounded(lines[near_lines]),
    }


@lru_cache(maxsize=KEPT)
def packed_map(name: str, sha256: str, box: Box | None) -> bytes:
    """Map of a catalog network as gzipped JSON; `sha256` is the network's hash, which decides the answer."""
    document = map_document(load_network(name), box)
    return gzip.compress(json.dumps(document, separators=(",", ":")).encode(), 6, mtime=0)


def _kinds(network: RoadNetwork) -> list[str]:
    """Kind of each lane for drawing; "" for lanes without interesting traffic."""
    lanes = network.lanes
    kinds = np.full(len(lanes.ids), "", dtype="<U8")
    # Later entries take precedence.
    kinds[lanes.pedestrian & ~lanes.internal] = "walk"
    kinds[lanes.bicycle & ~lanes.internal] = "bicycle"
    kinds[lanes.drivable] = "drive"
    kinds[lanes.drivable & lanes.internal] = "internal"
    kinds[lanes.crossing] = "crossing"
    return [str(kind) for kind in kinds]


def _near(points: FloatArray, start: Any, box: Box | None) -> BoolArray:
    """Selects the polylines whose bounding box meets the box.

    Args:
        points: (P, 2), m, of all polylines one after another.
        start: (N + 1,) first row of each.
        box: None: all.
    """
    count = len(start) - 1
    if box is None or not count:
        return np.ones(count, bool)
    filled = start[1:] > start[:-1]
    near = np.zeros(count, bool)
    first = np.asarray(start[:-1])[filled]
    low, high = np.minimum.reduceat(points, first), np.maximum.reduceat(points, first)
    x0, y0, x1, y1 = box
    near[filled] = (low[:, 0] <= x1) & (high[:, 0] >= x0) & (low[:, 1] <= y1) & (high[:, 1] >= y0)
    return near


def _rounded(values: FloatArray) -> list[list[float]]:
    rounded: list[list[float]] = np.round(np.asarray(values, np.float64), 2).tolist()
    return rounded
