"""RoadNetwork: the roads of one place as arrays, parsed once from a SUMO net and cached by content hash."""

from __future__ import annotations

import dataclasses
import math
import os
import zipfile
import zlib
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray, StringArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import staged
from dohyo.sumo_networks.geometry import SegmentGrid, crossed_segments, nearest_lane
from dohyo.sumo_networks.networks.parsing import file_hash, parse_net
from dohyo.sumo_networks.networks.xml_guard import check_size, scan

CACHE_VERSION = 5
GRID_CELL_M = 30.0
MOST_CELLS = 4_000_000
"""Of the grid of a network; one of larger extent has larger cells."""


@dataclass(frozen=True, slots=True)
class Lanes:
    """All L lanes, junction-internal ones included.

    Attributes:
        ids: (L,) SUMO lane ids.
        edge: (L,) index into `edge_ids`.
        index: (L,) position within the edge, 0 the rightmost.
        length: (L,), m, in SUMO's measure of positions.
        width: (L,), m.
        speed: (L,), m/s, the limit.
        drivable: (L,) open to passenger cars.
        bicycle: (L,) open to bicycles.
        pedestrian: (L,) open to pedestrians (sidewalks, crossings, walking areas).
        internal: (L,) inside a junction.
        crossing: (L,) pedestrian crossing.
        left: (L,) drivable neighbour to the left on the same edge, -1 if none.
        right: (L,) drivable neighbour to the right, -1 if none.
        start: (L + 1,) first row of each lane in `points`.
        points: (P, 2), m, centrelines.
        edge_ids: (E,) SUMO edge ids.
    """

    ids: StringArray
    edge: IntArray
    index: IntArray
    length: FloatArray
    width: FloatArray
    speed: FloatArray
    drivable: BoolArray
    bicycle: BoolArray
    pedestrian: BoolArray
    internal: BoolArray
    crossing: BoolArray
    left: IntArray
    right: IntArray
    start: IntArray
    points: FloatArray
    edge_ids: StringArray

    def longer_than(self, metres: float) -> IntArray:
        """(N,) lanes of roads that are open to passenger cars and longer, where drives can begin and end."""
        return np.flatnonzero(self.drivable & ~self.internal & (self.length > metres))


@dataclass(frozen=True, slots=True)
class Connections:
    """C links from lane to lane; a link from a road into a junction leads to its first internal lane.

    Attributes:
        source: (C,) lane.
        target: (C,) next lane (the internal lane, if there is one).
        direction: (C,) SUMO's letter: s straight, l left, r right, L, R partly, t turn, i inside a junction.
        signal: (C,) signal that controls the connection, -1 if none.
        control: (C,) SUMO's letter for the right of way without signals: M major, m minor, s stop, w all-way stop, ...
        first: (L + 1,) first connection out of each lane; connections are sorted by source.
        yields: (Y, 2) pairs of connections of one junction: the first must give way to the second.
    """

    source: IntArray
    target: IntArray
    direction: StringArray
    signal: IntArray
    control: StringArray
    first: IntArray
    yields: IntArray


@dataclass(frozen=True, slots=True)
class Signals:
    """The K signals of all traffic lights.

    Attributes:
        light_ids: (T,) SUMO traffic-light ids.
        light: (K,) index into `light_ids`.
        link: (K,) position in that light's state string.
    """

    light_ids: StringArray
    light: IntArray
    link: IntArray


@dataclass(frozen=True, slots=True)
class StopLines:
    """The S stop lines: ends of drivable lanes at a traffic light or a stop sign.

    Attributes:
        lane: (S,) lane that ends at the stop line.
        segment: (S, 4) right end x, y, left end x, y, m.
        lit: (S,) guarded by a traffic light.
        stop_sign: (S,) guarded by a stop sign.
    """

    lane: IntArray
    segment: FloatArray
    lit: BoolArray
    stop_sign: BoolArray


@dataclass(frozen=True, slots=True)
class Junctions:
    """The J junctions.

    Attributes:
        ids: (J,) SUMO ids.
        kind: (J,) SUMO's type (traffic_light, priority, right_before_left, ...).
        start: (J + 1,) first row of each polygon in `points`.
        points: (P, 2), m, outlines.
    """

    ids: StringArray
    kind: StringArray
    start: IntArray
    points: FloatArray


@dataclass(frozen=True, eq=False)
class RoadNetwork:
    """The roads of one place.

    Attributes:
        name: Name in the catalog, or the file's stem.
        path: Path of the SUMO net.
        sha256: Hash of the net file's bytes.
        lanes: All lanes.
        connections: Links from lane to lane.
        signals: Every signal.
        stop_lines: Stop lines at traffic lights and stop signs.
        junctions: Types and outlines of the junctions.
    """

    name: str
    path: Path
    sha256: str
    lanes: Lanes
    connections: Connections
    signals: Signals
    stop_lines: StopLines
    junctions: Junctions

    @cached_property
    def lane_index(self) -> dict[str, int]:
        """Lane index by SUMO id."""
        return {str(name): i for i, name in enumerate(self.lanes.ids)}

    @cached_property
    def lanes_of_edge(self) -> dict[str, list[int]]:
        """Lane indices of each edge, from right to left."""
        out: dict[str, list[int]] = {str(edge): [] for edge in self.lanes.edge_ids}
        for lane in np.lexsort((self.lanes.index, self.lanes.edge)):
            out[self.edge_id(int(lane))].append(int(lane))
        return out

    @cached_property
    def gives_way_to(self) -> set[tuple[int, int]]:
        """Pairs of connections (a, b): a vehicle on a must give way to a vehicle on b."""
        return {(int(a), int(b)) for a, b in self.connections.yields}

    def edge_id(self, lane: int) -> str:
        """SUMO id of the edge a lane belongs to."""
        return str(self.lanes.edge_ids[self.lanes.edge[lane]])

    def lane_shape(self, lane: int) -> FloatArray:
        """(P, 2), m: the lane's centreline."""
        return self.lanes.points[self.lanes.start[lane] : self.lanes.start[lane + 1]]

    def junction_shape(self, junction: int) -> FloatArray:
        """(P, 2), m: the junction's outline."""
        return self.junctions.points[self.junctions.start[junction] : self.junctions.start[junction + 1]]

    def connections_from(self, lane: int) -> range:
        """Indices of the connections out of a lane."""
        return range(int(self.connections.first[lane]), int(self.connections.first[lane + 1]))

    def edge_behind(self, lane: int) -> int:
        """The first edge outside a junction that a lane inside it leads to; of other lanes, their own.

        Where lanes inside lead to each other for ever, which netconvert makes of no road, it is the last one's.
        """
        passed: set[int] = set()
        while self.lanes.internal[lane] and lane not in passed and (onward := self.connections_from(lane)):
            passed.add(lane)
            lane = int(self.connections.target[onward[0]])
        return int(self.lanes.edge[lane])

    def lane_point(self, lane: int, position: float) -> tuple[float, float, float]:
        """Point on a lane's centreline.

        Args:
            lane: Index of the lane.
            position: Position along the lane in SUMO's measure, m; negative counts from the end.

        Returns:
            x [m], y [m], direction [rad].
        """
        shape = self.lane_shape(lane)
        steps = np.diff(shape, axis=0)
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
        length = float(self.lanes.length[lane])
        fraction = (position if position >= 0 else position + length) / length
        s = np.clip(fraction, 0.0, 1.0) * arc[-1]
        i = int(np.clip(np.searchsorted(arc, s, side="right") - 1, 0, len(steps) - 1))
        x, y = shape[i] + steps[i] * ((s - arc[i]) / (arc[i + 1] - arc[i]))
        return float(x), float(y), math.atan2(steps[i, 1], steps[i, 0])

    def nearest_lane(self, x: float, y: float, heading: float, preferred: BoolArray) -> tuple[int, float, float]:
        """Drivable lane under a vehicle; see `geometry.nearest_lane`."""
        return nearest_lane(x, y, heading, self._grid, preferred)

    def crossed_stop_lines(self, x0: float, y0: float, x1: float, y1: float) -> IntArray:
        """Indices of the stop lines that a motion crosses in driving direction."""
        return crossed_segments(x0, y0, x1, y1, self.stop_lines.segment)

    @cached_property
    def drivable_area(self) -> shapely.Geometry:
        """Union of the drivable lanes and of the junctions that connect them."""
        strips = [
            shapely.buffer(shapely.linestrings(self.lane_shape(i)), self.lanes.width[i] / 2, cap_style="flat")
            for i in np.flatnonzero(self.lanes.drivable).tolist()
        ]
        outlines = (self.junction_shape(j) for j in range(len(self.junctions.ids)))
        polygons = [shapely.make_valid(shapely.polygons(shape)) for shape in outlines if len(shape) >= 3]
        return shapely.union_all([*strips, *polygons])

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """Smallest x, smallest y, largest x, largest y of all drivable lanes, m."""
        points = np.concatenate([self.lane_shape(i) for i in np.flatnonzero(self.lanes.drivable).tolist()])
        (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
        return float(x0), float(y0), float(x1), float(y1)

    @cached_property
    def _grid(self) -> SegmentGrid:
        """The segments of the drivable lanes."""
        segments, owners = [], []
        for lane in np.flatnonzero(self.lanes.drivable):
            shape = self.lane_shape(int(lane))
            pieces = np.concatenate([shape[:-1], shape[1:]], axis=1)
            pieces = pieces[np.hypot(pieces[:, 2] - pieces[:, 0], pieces[:, 3] - pieces[:, 1]) > 1e-6]
            segments.append(pieces)
            owners.append(np.full(len(pieces), lane))
        table, owner = np.concatenate(segments), np.concatenate(owners).astype(np.int64)
        low = np.minimum(table[:, :2], table[:, 2:]).min(axis=0) - GRID_CELL_M
        high = np.maximum(table[:, :2], table[:, 2:]).max(axis=0) + GRID_CELL_M
        cell = max(GRID_CELL_M, float(np.sqrt(np.prod(high - low) / MOST_CELLS)))
        columns, rows = (int(n) + 1 for n in (high - low) / cell)
        cells: list[list[int]] = [[] for _ in range(columns * rows)]
        corners = np.floor((table.reshape(-1, 2, 2) - low) / cell).astype(int)
        for i, ((c0, r0), (c1, r1)) in enumerate(corners):
            for r in range(min(r0, r1), max(r0, r1) + 1):
                for c in range(min(c0, c1), max(c0, c1) + 1):
                    cells[r * columns + c].append(i)
        starts = np.concatenate([[0], np.cumsum([len(cell) for cell in cells])]).astype(np.int64)
        members = np.array([i for cell in cells for i in cell], dtype=np.int64)
        return table, owner, self.lanes.width / 2, starts, members, low, cell, columns, rows


_GROUPS = {
    "lanes": Lanes,
    "connections": Connections,
    "signals": Signals,
    "stop_lines": StopLines,
    "junctions": Junctions,
}


def read_network(path: Path, name: str, limit_mb: float = math.inf) -> RoadNetwork:
    """Reads a SUMO net: parses it, or loads the arrays of an earlier parse of the same bytes from the cache.

    Args:
        path: A .net.xml or .net.xml.gz file.
        name: Name of the network.
        limit_mb: Largest size, packed or unpacked, MB.

    Raises:
        InvalidInputError: The file is missing, too large, harmful or no SUMO net, has left-hand traffic, has no lane
            open to cars, or has a lane or junction of an impossible size or shape.
    """
    check_size(path, limit_mb)
    sha256 = file_hash(path)
    cached = cache_folder() / parsed_name(sha256)
    tables = _kept_tables(cached)
    if tables is None:
        if scan(path, "net", limit_mb).left_hand:
            raise InvalidInputError(
                f"network file '{path}' has left-hand traffic, in which dohyo cannot drive: `dohyo networks import` "
                "makes its mirror image, in which traffic drives on the right"
            )
        tables = parse_net(path)
        with suppress(OSError):  # a process that may not store it, or finds no room, can still use it
            cached.parent.mkdir(parents=True, exist_ok=True)
            with staged(cached) as draft, draft.open("wb") as file:
                np.savez_compressed(file, **tables)  # type: ignore[arg-type]
    groups = {
        group: kind(**{field.name: tables[f"{group}.{field.name}"] for field in dataclasses.fields(kind)})
        for group, kind in _GROUPS.items()
    }
    return RoadNetwork(name=name, path=path, sha256=sha256, **groups)


def _kept_tables(cached: Path) -> dict[str, Any] | None:
    """The arrays of an earlier parse; None where there are none, or a damaged file, which is written anew."""
    try:
        with np.load(cached, allow_pickle=False) as file:
            return {key: file[key] for key in file.files}
    except (OSError, EOFError, ValueError, zipfile.BadZipFile, zlib.error):
        return None


def parsed_name(sha256: str) -> str:
    """Path of a parsed network in the cache folder, by the hash of its net."""
    return f"networks/{sha256}-v{CACHE_VERSION}.npz"


def cache_folder() -> Path:
    """Folder of parsed networks: $DOHYO_CACHE, else the user's cache folder."""
    explicit = os.environ.get("DOHYO_CACHE")
    if explicit:
        return Path(explicit)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dohyo"
