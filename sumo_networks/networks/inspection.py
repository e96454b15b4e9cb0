"""Inspection: the content of a network, and the faults of its geometry."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.networks.entries import NetworkSize
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.units import KMH_PER_MPS

MIN_LENGTH_M = 0.5
MAX_KINK = np.radians(60.0)
# A compact car at full lock: 2.7 m of wheelbase, 0.6 rad at the front wheels.
MIN_RADIUS_M = 4.0
CURVATURE_SPAN_M = 3.0


@dataclass(frozen=True, slots=True)
class LaneFault:
    """A lane whose geometry is suspicious.

    Attributes:
        lane: SUMO lane id.
        kind: "short" (m), "kink" (degrees) or "curvature" (radius in m).
        value: Measured value, in the unit of its kind.
    """

    lane: str
    kind: str
    value: float


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
        faults: Lanes with suspicious geometry, inside junctions too.
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
    faults: tuple[LaneFault, ...]
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
    inside = _largest_part(network) & road
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
        faults=tuple(_faults(network)),
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


def _largest_part(network: RoadNetwork) -> BoolArray:
    """(L,) whether a lane is in the largest strongly connected set, by connections and lane changes."""
    lanes, connections = network.lanes, network.connections
    drives = lanes.drivable[connections.source] & lanes.drivable[connections.target]
    source, target = connections.source[drives], connections.target[drives]
    for side in (lanes.left, lanes.right):
        has = np.flatnonzero((side >= 0) & lanes.drivable)
        source, target = np.concatenate([source, has]), np.concatenate([target, side[has]])
    forward, backward = _adjacency(source, target, len(lanes.ids)), _adjacency(target, source, len(lanes.ids))
    left = set(np.flatnonzero(lanes.drivable).tolist())
    order = _finishing_order(forward, sorted(left))
    best: set[int] = set()
    for root in reversed(order):
        if root in left:
            part = _reached(backward, root, left)
            left -= part
            if len(part) > len(best):
                best = part
    out = np.zeros(len(lanes.ids), dtype=np.bool_)
    out[sorted(best)] = True
    return out


def _adjacency(source: IntArray, target: IntArray, count: int) -> list[list[int]]:
    out: list[list[int]] = [[] for _ in range(count)]
    for a, b in zip(source.tolist(), target.tolist(), strict=True):
        out[a].append(b)
    return out


def _finishing_order(graph: list[list[int]], nodes: list[int]) -> list[int]:
    """Nodes in the order in which a depth-first search leaves them (Kosaraju's first pass)."""
    order, seen = [], set()
    for root in nodes:
        if root in seen:
            continue
        seen.add(root)
        stack = [(root, iter(graph[root]))]
        while stack:
            followers = stack[-1][1]
            following = next((n for n in followers if n not in seen), None)
            if following is None:
                order.append(stack.pop()[0])
            else:
                seen.add(following)
                stack.append((following, iter(graph[following])))
    return order


def _reached(graph: list[list[int]], root: int, among: set[int]) -> set[int]:
    part, stack = {root}, [root]
    while stack:
        for following in graph[stack.pop()]:
            if following in among and following not in part:
                part.add(following)
                stack.append(following)
    return part


def _faults(network: RoadNetwork) -> list[LaneFault]:
    lanes, connections = network.lanes, network.connections
    turning_round = set(connections.target[connections.direction == "t"].tolist())
    found = []
    for lane in np.flatnonzero(lanes.drivable).tolist():
        name, length, shape = str(lanes.ids[lane]), float(lanes.length[lane]), network.lane_shape(lane)
        if not lanes.internal[lane] and length < MIN_LENGTH_M:
            found.append(LaneFault(name, "short", round(length, 2)))
        if lane in turning_round:
            continue
        kink, radius = _sharpest(shape)
        if kink > MAX_KINK:
            found.append(LaneFault(name, "kink", round(float(np.degrees(kink)))))
        elif radius < MIN_RADIUS_M:
            found.append(LaneFault(name, "curvature", round(radius, 1)))
    return found


def _sharpest(shape: FloatArray) -> tuple[float, float]:
    """Largest angle between two segments of a line [rad], and its smallest radius over 3 m [m]."""
    steps = np.diff(shape, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    steps, lengths = steps[lengths > 0.05], lengths[lengths > 0.05]
    if len(steps) < 2:
        return 0.0, np.inf
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    kink = float(np.abs(np.diff(heading)).max())
    middle = np.cumsum(lengths) - lengths / 2
    at = np.arange(0.0, lengths.sum() + 1e-9, 0.5)
    span = max(int(CURVATURE_SPAN_M / 0.5), 1)
    if len(at) <= span:
        return kink, np.inf
    sampled = np.interp(at, middle, heading)
    turn = float(np.abs(sampled[span:] - sampled[:-span]).max())
    return kink, CURVATURE_SPAN_M / turn if turn > 1e-9 else np.inf
