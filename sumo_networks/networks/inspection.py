"""Inspection: the content of a network, and its faults."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.networks.connectivity import largest_part
from dohyo.sumo_networks.networks.entries import NetworkSize
from dohyo.sumo_networks.networks.faults import Fault, find_faults
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.units import KMH_PER_MPS


@dataclass(frozen=True, slots=True)
class NetworkReport:
    """Report on one network; "lanes" are the lanes open to cars, outside junctions.

    Attributes:
        name: Name of the network.
        sha256: Hash of the network's file.
        lanes: Number of lanes.
        lane_km: Total length of the lanes, km.
        road_km: Length of the roads to the middle of their junctions, km; both directions of a road count once.
        junctions: Number of junctions by SUMO's type.
        lights: Number of traffic lights.
        crossings: Number of pedestrian crossings.
        stop_signs: Number of lanes that end at a stop sign.
        dead_ends: SUMO ids of edges from which cars can only turn round or leave the network.
        connected_share: Share of lanes in the largest strongly connected part of the network.
        outside: SUMO ids of edges with lanes outside that part.
        speed_limits_kmh: Length of lanes [km] by speed limit [km/h].
        sidewalk_share: Share of the edges' length with a sidewalk.
        faults: Places that disturb drivers.
        guessed: Guesses and repairs of the import.
    """

    name: str
    sha256: str
    lanes: int
    lane_km: float
    road_km: float
    junctions: dict[str, int]
    lights: int
    crossings: int
    stop_signs: int
    dead_ends: tuple[str, ...]
    connected_share: float
    outside: tuple[str, ...]
    speed_limits_kmh: dict[int, float]
    sidewalk_share: float
    faults: tuple[Fault, ...]
    guessed: tuple[str, ...] = ()

    def as_document(self) -> dict[str, Any]:
        """The report as a JSON document."""
        return dataclasses.asdict(self)


def network_size(network: RoadNetwork) -> NetworkSize:
    """Measures the size of a network, for lists of networks."""
    lanes = network.lanes
    road = lanes.drivable & ~lanes.internal
    return NetworkSize(
        lanes=int(road.sum()),
        lane_km=round(float(lanes.length[road].sum()) / 1000, 1),
        lights=len(network.signals.light_ids),
        crossings=int(lanes.crossing.sum()),
    )


def inspect_network(network: RoadNetwork, guessed: Sequence[str] = ()) -> NetworkReport:
    """Checks a network.

    Args:
        network: The roads.
        guessed: Guesses and repairs of its import.
    """
    lanes = network.lanes
    road = lanes.drivable & ~lanes.internal
    inside = largest_part(network) & road
    outside = np.unique(lanes.edge[road & ~inside])
    edges, rows = np.unique(lanes.edge[road], return_index=True)
    length = lanes.length[road][rows]
    walkable = np.isin(edges, lanes.edge[lanes.pedestrian & ~lanes.drivable])
    limits = np.round(lanes.speed[road] * KMH_PER_MPS).astype(int)
    kinds = Counter(str(kind) for kind in network.junctions.kind)
    return NetworkReport(
        name=network.name,
        sha256=network.sha256,
        lanes=int(road.sum()),
        lane_km=_km(float(lanes.length[road].sum())),
        road_km=_km(_road_length(network, road)),
        junctions={kind: kinds[kind] for kind in sorted(kinds)},
        lights=len(network.signals.light_ids),
        crossings=int(lanes.crossing.sum()),
        stop_signs=int(network.stop_lines.stop_sign.sum()),
        dead_ends=_edge_names(network, _dead_ends(network, road)),
        connected_share=round(float(inside.sum() / max(road.sum(), 1)), 4),
        outside=_edge_names(network, outside),
        speed_limits_kmh={
            int(limit): _km(float(lanes.length[road][limits == limit].sum())) for limit in np.unique(limits)
        },
        sidewalk_share=round(float(length[walkable].sum() / max(length.sum(), 1e-9)), 4),
        faults=find_faults(network),
        guessed=tuple(guessed),
    )


def _km(metres: float) -> float:
    return round(metres / 1000, 3)


def _edge_names(network: RoadNetwork, edges: IntArray) -> tuple[str, ...]:
    return tuple(sorted(str(network.lanes.edge_ids[edge]) for edge in edges))


def _road_length(network: RoadNetwork, road: BoolArray) -> float:
    """Length of all roads, m; an edge with a parallel edge in the other direction counts half.

    Edges are extended to the middle of their junctions.
    """
    lanes = network.lanes
    innermost = np.flatnonzero(road & (lanes.left < 0))
    begin, end = lanes.points[lanes.start[innermost]], lanes.points[lanes.start[innermost + 1] - 1]
    middle = np.array([network.lane_point(i, float(lanes.length[i]) / 2)[:2] for i in innermost.tolist()])
    length = lanes.length[innermost] + _to_junctions(network, begin, end)
    total = 0.0
    for i in range(len(innermost)):
        near = 2 * lanes.width[innermost[i]] + 2.0
        opposite = np.hypot(*(begin - end[i]).T) < near
        opposite &= np.hypot(*(end - begin[i]).T) < near
        opposite &= np.hypot(*(middle - middle[i]).T) < near
        opposite[i] = False
        total += length[i] * (0.5 if opposite.any() else 1.0)
    return float(total)


def _to_junctions(network: RoadNetwork, begin: FloatArray, end: FloatArray) -> FloatArray:
    """(N,) sum of the distances from both ends of each lane to the middle of the junction there, m."""
    outlines = [network.junction_shape(j) for j in range(len(network.junctions.ids))]
    polygons = [shapely.convex_hull(shapely.multipoints(shape)) for shape in outlines if len(shape)]
    ends = np.concatenate([begin, end])
    junction = shapely.STRtree(polygons).nearest(shapely.points(ends))
    count = np.maximum(np.bincount(junction, minlength=len(polygons)), 1)
    middle = np.column_stack([np.bincount(junction, ends[:, k], len(polygons)) / count for k in (0, 1)])
    gap = np.hypot(*(ends - middle[junction]).T)
    total: FloatArray = gap[: len(begin)] + gap[len(begin) :]
    return total


def _dead_ends(network: RoadNetwork, road: BoolArray) -> IntArray:
    lanes, connections = network.lanes, network.connections
    onward = road[connections.source] & lanes.drivable[connections.target] & (connections.direction != "t")
    return np.setdiff1d(lanes.edge[road], lanes.edge[connections.source[onward]])
