"""Surfaces: the ground of a network as polygons in painting order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

import numpy as np
from sumolib.net.lane import get_allowed

from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.networks.xml_guard import read_elements

CELL_M = 32.0
LONGEST_M = 25.0
KERB_M = 0.15
OVERLAP_M = 0.02
LINE_M = 0.14
STOP_LINE_M = 0.5
DASH_M, DASH_PERIOD_M = 3.0, 7.5
STRIPE_M, STRIPE_PERIOD_M = 0.5, 1.0
SHARPEST_MITRE = 1.6


class Surface(IntEnum):
    """Kind of ground surface."""

    TERRAIN = 0
    ROAD = 1
    LINE = 2
    STOP_LINE = 3
    CROSSING = 4
    STRIPE = 5
    SIDEWALK = 6
    KERB = 7
    CYCLEWAY = 8
    TRACK = 9


@dataclass(frozen=True)
class Ground:
    """Polygons of the ground of one network.

    Attributes:
        quads: (Q, 4, 2) corners, m, network frame; sorted by cell.
        surface: (Q,) Surface of each.
        layer: (Q,) layer of each; lower layers are painted first.
        thin: (Q,) whether it is a marking that coarse pictures must widen.
        outlines: Outlines of junctions and walking areas, (P, 2) each, m.
        outline_surface: Surface of each outline.
        outline_layer: Layer of each outline.
        outline_bounds: (N, 4) smallest x, y, largest x, y of each outline, m.
        cells: Index of the quads by cell.
    """

    quads: Float32Array
    surface: IntArray
    layer: IntArray
    thin: BoolArray
    outlines: tuple[FloatArray, ...]
    outline_surface: IntArray
    outline_layer: IntArray
    outline_bounds: FloatArray
    cells: CellIndex


class CellIndex:
    """Index of points by square cells, for look-ups by rectangle.

    Attributes:
        order: Order in which the caller must sort the objects at the points.
    """

    def __init__(self, points: FloatArray) -> None:
        self._low = points.min(axis=0) if len(points) else np.zeros(2)
        cell = np.floor((points - self._low) / CELL_M).astype(np.int64)
        self._columns, self._rows = (int(n) + 1 for n in cell.max(axis=0, initial=0))
        number = cell[:, 1] * self._columns + cell[:, 0]
        self.order: IntArray = np.argsort(number, kind="stable")
        self._start = np.searchsorted(number[self.order], np.arange(self._columns * self._rows + 1))

    def near(self, x0: float, y0: float, x1: float, y1: float, margin: float = 0.0) -> IntArray:
        """Rows, in the sorted order, of all points in a rectangle and of some points around it."""
        first = np.floor((np.array([x0, y0]) - margin - self._low) / CELL_M).astype(int)
        last = np.floor((np.array([x1, y1]) + margin - self._low) / CELL_M).astype(int)
        left, right = max(int(first[0]), 0), min(int(last[0]), self._columns - 1)
        ranges = [
            np.arange(self._start[row * self._columns + left], self._start[row * self._columns + right + 1])
            for row in range(max(int(first[1]), 0), min(int(last[1]), self._rows - 1) + 1)
            if left <= right
        ]
        return np.concatenate(ranges) if ranges else np.empty(0, dtype=np.int64)


@lru_cache(maxsize=4)
def ground_of(network: RoadNetwork) -> Ground:
    """Ground of a network; the last few are cached."""
    parts = list(_layers(network))
    quads = np.concatenate([quads for quads, _, _ in parts]).astype(np.float32)
    surface = np.concatenate([np.full(len(quads), kind) for quads, kind, _ in parts])
    layer = np.concatenate([np.full(len(quads), layer) for quads, _, layer in parts])
    cells = CellIndex(quads.mean(axis=1).astype(np.float64))
    surface = surface[cells.order]
    outlines, outline_surface, outline_layer = _outlines(network)
    bounds = [[*outline.min(axis=0), *outline.max(axis=0)] for outline in outlines]
    return Ground(
        quads=np.ascontiguousarray(quads[cells.order]),
        surface=surface,
        layer=layer[cells.order],
        thin=np.isin(surface, (Surface.LINE, Surface.STOP_LINE)),
        outlines=tuple(outlines),
        outline_surface=np.array(outline_surface, dtype=np.int64),
        outline_layer=np.array(outline_layer, dtype=np.int64),
        outline_bounds=np.array(bounds, dtype=np.float64).reshape(-1, 4),
        cells=cells,
    )


# Outlines of junctions have layer 2 and of walking areas layer 4, each above its own kerb.
_TRACK, _JUNCTION_KERB, _JUNCTION, _WALK_KERB, _WALK, _CYCLE, _ROAD_KERB, _ROAD, _CROSS, _STRIPE, _LINE = range(11)


def _layers(network: RoadNetwork) -> Iterator[tuple[FloatArray, Surface, int]]:
    lanes = network.lanes
    inside = np.char.startswith(lanes.ids, ":")
    foot = lanes.pedestrian & ~lanes.drivable & ~inside
    tracks, others = _tracks_and_streets(network)
    cycle = lanes.bicycle & ~lanes.pedestrian & ~lanes.drivable & ~others & ~inside
    street = (lanes.drivable | others) & ~lanes.internal
    half = lanes.width / 2
    yield _Lines(network, tracks & ~inside).band(half), Surface.TRACK, _TRACK
    outlines, _, layers = _outlines(network)
    for layer, kerb in ((_JUNCTION, _JUNCTION_KERB), (_WALK, _WALK_KERB)):
        rims = [_rim(outline) for outline, its in zip(outlines, layers, strict=True) if its == layer]
        yield np.concatenate([np.empty((0, 4, 2)), *rims]), Surface.KERB, kerb
    sidewalk, road = _Lines(network, foot), _Lines(network, street)
    yield sidewalk.band(half + KERB_M), Surface.KERB, _WALK_KERB
    yield sidewalk.band(half), Surface.SIDEWALK, _WALK
    yield _Lines(network, cycle).band(half), Surface.CYCLEWAY, _CYCLE
    yield road.band(half + KERB_M), Surface.KERB, _ROAD_KERB
    # A little wider than the lane, so that no kerb is visible between two lanes.
    yield _Lines(network, lanes.drivable | others).band(half + OVERLAP_M), Surface.ROAD, _ROAD
    crossing = _Lines(network, lanes.crossing)
    yield crossing.band(half), Surface.CROSSING, _CROSS
    yield crossing.dashes(0.0, half, STRIPE_M, STRIPE_PERIOD_M), Surface.STRIPE, _STRIPE
    thin = np.full(len(half), LINE_M / 2)
    yield _Lines(network, street & (lanes.left < 0)).band(thin, half), Surface.LINE, _LINE
    yield _Lines(network, street & (lanes.left >= 0)).dashes(half, thin, DASH_M, DASH_PERIOD_M), Surface.LINE, _LINE
    yield _stop_lines(network), Surface.STOP_LINE, _LINE


@lru_cache(maxsize=4)
def _tracks_and_streets(network: RoadNetwork) -> tuple[BoolArray, BoolArray]:
    """(L,) tracks, and (L,) streets without cars, as for buses and deliveries; without lanes where people walk.

    The tables of a network do not tell one from the other, but its file does.
    """
    lanes = network.lanes
    unknown = ~(lanes.drivable | lanes.pedestrian)
    tracks, streets = np.zeros_like(unknown), np.zeros_like(unknown)
    if not unknown.any():
        return tracks, streets
    allowed: dict[str, frozenset[str]] = {}

    def element(tag: str, attributes: dict[str, str]) -> None:
        if tag == "lane":
            allowed[attributes["id"]] = frozenset(get_allowed(attributes.get("allow"), attributes.get("disallow")))

    read_elements(network.path, element)
    for lane in np.flatnonzero(unknown).tolist():
        classes = allowed[str(lanes.ids[lane])]
        others = _NO_VEHICLES_OF_ROADS | (_OF_CYCLEWAYS if lanes.bicycle[lane] else frozenset())
        streets[lane] = bool(classes - _RAIL - others)
        tracks[lane] = not streets[lane] and not lanes.bicycle[lane] and bool(classes & _RAIL)
    return tracks, streets


_RAIL = frozenset(("tram", "rail_urban", "rail", "rail_electric", "rail_fast", "subway", "cable_car"))
_NO_VEHICLES_OF_ROADS = frozenset(("ship", "aircraft", "drone"))
_OF_CYCLEWAYS = frozenset(("bicycle", "scooter", "moped", "wheelchair", "emergency", "authority"))


class _Lines:
    """Centrelines of chosen lanes, cut into pieces of at most 25 m, with a normal at every point."""

    def __init__(self, network: RoadNetwork, chosen: BoolArray) -> None:
        lane, points = _without_repeats(network, chosen)
        lane, points = _cut(lane, points)
        step = np.diff(points, axis=0)
        self.lane, self.points = lane, points
        self.joined: BoolArray = lane[1:] == lane[:-1]
        length = np.hypot(step[:, 0], step[:, 1])
        along = np.where(self.joined[:, None], step / np.maximum(length, 1e-9)[:, None], 0.0)
        before, after = np.vstack([np.zeros(2), along]), np.vstack([along, np.zeros(2)])
        tangent = before + after
        norm = np.maximum(np.hypot(tangent[:, 0], tangent[:, 1]), 1e-9)
        tangent /= norm[:, None]
        # At a bend, the offset of a corner is the distance divided by the cosine of half the angle.
        corner = np.minimum(np.where(norm > 1.01, 2.0 / norm, 1.0), SHARPEST_MITRE)
        self.normal = np.column_stack([-tangent[:, 1], tangent[:, 0]]) * corner[:, None]
        # One arc length for all lanes, with a gap of 100 m between two of them.
        self.arc = np.concatenate([[0.0], np.cumsum(np.where(self.joined, length, 100.0))])

    def band(self, half: FloatArray, aside: FloatArray | float = 0.0) -> FloatArray:
        """(Q, 4, 2) strips along the lanes.

        Args:
            half: (L,) half the strip's width by lane, m.
            aside: (L,) or a number: distance of the strip's middle to the left of the centreline, m.
        """
        middle = np.broadcast_to(aside, np.shape(half))[self.lane]
        left = self.points + self.normal * (middle + half[self.lane])[:, None]
        right = self.points + self.normal * (middle - half[self.lane])[:, None]
        return np.stack([right[:-1], right[1:], left[1:], left[:-1]], axis=1)[self.joined]

    def dashes(self, aside: FloatArray | float, half: FloatArray, on: float, period: float) -> FloatArray:
        """(Q, 4, 2) dashes along the lanes, `on` m long, one every `period` m, centred on each lane."""
        if not len(self.points):
            return np.empty((0, 4, 2))
        first = np.flatnonzero(np.concatenate([[True], ~self.joined]))
        last = np.concatenate([first[1:] - 1, [len(self.points) - 1]])
        length = self.arc[last] - self.arc[first]
        count = np.floor((length - on) / period + 1e-9).astype(np.int64) + 1
        count = np.maximum(count, 0)
        margin = (length - (count - 1) * period - on) / 2
        number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        begin = np.repeat(self.arc[first] + margin, count) + number * period
        lane = np.repeat(self.lane[first], count)
        line = self.points + self.normal * np.broadcast_to(aside, np.shape(half))[self.lane][:, None]
        a, b = (np.column_stack([np.interp(at, self.arc, line[:, i]) for i in (0, 1)]) for at in (begin, begin + on))
        return _thick(a, b, half[lane])


def _without_repeats(network: RoadNetwork, chosen: BoolArray) -> tuple[IntArray, FloatArray]:
    """Lane of every point of the chosen lanes, and the points; repeated points are left out."""
    lanes = network.lanes
    lane = np.repeat(np.arange(len(lanes.ids)), np.diff(lanes.start))
    keep = chosen[lane]
    lane, points = lane[keep], lanes.points[keep]
    new = np.ones(len(lane), dtype=np.bool_)
    new[1:] = (lane[1:] != lane[:-1]) | (np.hypot(*np.diff(points, axis=0).T) > 1e-3)
    return lane[new], points[new]


def _cut(lane: IntArray, points: FloatArray) -> tuple[IntArray, FloatArray]:
    """Adds points, so that consecutive points of a lane are at most 25 m apart."""
    if len(lane) < 2:
        return lane, points
    step = np.diff(points, axis=0)
    pieces = np.where(lane[1:] == lane[:-1], np.ceil(np.hypot(step[:, 0], step[:, 1]) / LONGEST_M), 1.0)
    pieces = np.maximum(pieces, 1.0).astype(np.int64)
    source = np.repeat(np.arange(len(step)), pieces)
    number = np.arange(len(source)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    between = points[source] + step[source] * (number / pieces[source])[:, None]
    return np.append(lane[source], lane[-1]), np.vstack([between, points[-1:]])


def _thick(a: FloatArray, b: FloatArray, half: FloatArray) -> FloatArray:
    """(Q, 4, 2) rectangles around the lines from a to b."""
    along = b - a
    along = along / np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
    across = np.column_stack([-along[:, 1], along[:, 0]]) * half[:, None]
    return np.stack([a - across, b - across, b + across, a + across], axis=1)


def _rim(outline: FloatArray) -> FloatArray:
    """(Q, 4, 2) kerb around an outline, in pieces of at most 25 m."""
    closed = np.vstack([outline, outline[:1]])
    _, points = _cut(np.zeros(len(closed), dtype=np.int64), closed)
    return _thick(points[:-1], points[1:], np.full(len(points) - 1, KERB_M))


def _outlines(network: RoadNetwork) -> tuple[list[FloatArray], list[Surface], list[int]]:
    """Outlines with surface and layer: junctions of streets are road, others and walking areas are sidewalk."""
    lanes = network.lanes
    names, paved = [str(name) for name in lanes.ids], lanes.drivable | _tracks_and_streets(network)[1]
    driven = {name[1:].rsplit("_", 2)[0] for name, yes in zip(names, paved, strict=True) if yes and name[0] == ":"}
    shapes: list[FloatArray] = []
    surfaces: list[Surface] = []
    layers: list[int] = []
    for junction, name in enumerate(network.junctions.ids):
        kind, shape = str(network.junctions.kind[junction]), network.junction_shape(junction)
        is_road = str(name) in driven
        if len(shape) < 3 or (not is_road and (kind == "dead_end" or kind.startswith("rail"))):
            continue
        shapes.append(shape)
        surfaces.append(Surface.ROAD if is_road else Surface.SIDEWALK)
        layers.append(_JUNCTION)
    walking = np.char.startswith(lanes.ids, ":") & lanes.pedestrian & ~lanes.internal & ~lanes.crossing
    for lane in np.flatnonzero(walking & ~lanes.drivable).tolist():
        shape = network.lane_shape(lane)
        if len(shape) >= 3:
            shapes.append(shape)
            surfaces.append(Surface.SIDEWALK)
            layers.append(_WALK)
    return shapes, surfaces, layers


def _stop_lines(network: RoadNetwork) -> FloatArray:
    """(Q, 4, 2) strips of half a metre before each stop line."""
    right, left = network.stop_lines.segment[:, :2], network.stop_lines.segment[:, 2:]
    across = left - right
    across = across / np.maximum(np.hypot(across[:, 0], across[:, 1]), 1e-9)[:, None]
    back = np.column_stack([-across[:, 1], across[:, 0]]) * STOP_LINE_M
    return np.stack([right + back, right, left, left + back], axis=1)
