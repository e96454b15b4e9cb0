"""CARLA route files: their waypoints, snapped to the lanes of an imported town, as the missions of a benchmark.

CARLA's frame is left-handed: y grows to the right of x, so it is the negative of OpenDRIVE's y. netconvert moves a town
by an offset, which the net records. Source: CARLA Leaderboard, route files of versions 1 and 2; scenario_runner; the
files of NoCrash and CoRL 2017 with an `<ego_vehicle>` around the waypoints.
"""

from __future__ import annotations

import re
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from pydantic import ValidationError

from dohyo.evaluation.benchmarks.benchmark import Benchmark, ScriptedMission
from dohyo.evaluation.benchmarks.cells import Level, Protocol, make_cells
from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.faults import describe_fault
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.networks.projection import read_offset
from dohyo.sumo_networks.networks.xml_guard import scan
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place, Traffic

MAX_SNAP_M = 5.0
WAYPOINTS = ("waypoints/position", "waypoint", "ego_vehicle[1]/waypoint", "ego_vehicle[1]/waypoints/position")
"""Places of the waypoints in a <route>, by dialect; of several ego vehicles the first is taken."""
# An ego is placed by the centre of its box; nearer to the start of a lane its rear would be in the junction.
END_ROOM_M = 0.1
AT_BORDER_M = 0.5
"""An end that is nearly as near to a road as to a way through a junction belongs to the road."""
OUT_OF_JUNCTION_M = 3.0
"""Distance from a junction to an end that was moved out of it."""


@dataclass(frozen=True, slots=True)
class CarlaRoute:
    """One route of a file.

    Attributes:
        id: Identifier of the route in the file.
        town: Name of the town, such as "Town01"; "" if the file does not have it.
        waypoints: (N, 2) positions, m, CARLA's frame.
    """

    id: str
    town: str
    waypoints: FloatArray


@dataclass(frozen=True, slots=True)
class Snap:
    """Result of snapping the waypoints of a route to the network.

    Attributes:
        mission: Name of the mission in the benchmark.
        moved_m: Distance by which each waypoint was moved, m.
        unused: Number of waypoints inside junctions, which the mission does not need.
        notes: Ends that were moved out of a junction, one line each.
    """

    mission: str
    moved_m: tuple[float, ...]
    unused: int
    notes: tuple[str, ...] = ()

    @property
    def mean_m(self) -> float:
        """Mean distance, m."""
        return float(np.mean(self.moved_m))

    def as_document(self) -> dict[str, Any]:
        """The result as plain JSON."""
        return {
            "mission": self.mission,
            "moved_m": list(self.moved_m),
            "unused": self.unused,
            "notes": list(self.notes),
        }


@dataclass(frozen=True, slots=True)
class ImportedRoutes:
    """A benchmark made of a route file.

    Attributes:
        benchmark: The benchmark.
        snaps: Result of each route that became a mission.
        skipped: Reasons by the id of each route that did not.
        reduced: Number of vehicles that would jam the network, by each level that has fewer for this reason.
    """

    benchmark: Benchmark
    snaps: tuple[Snap, ...]
    skipped: Mapping[str, str]
    reduced: Mapping[Level, int]


def import_routes(
    file: Path,
    network: str,
    *,
    name: str | None = None,
    town: str | None = None,
    traffic: Traffic | Sequence[Level] = (Level.EMPTY,),
    conditions: Sequence[str] = ("clear",),
    protocol: Protocol = Protocol.LEADERBOARD,
    seeds: Sequence[int] = (0,),
    max_snap_m: float = MAX_SNAP_M,
    skip: bool = False,
) -> ImportedRoutes:
    """A benchmark with one mission per route; each is planned once, which shows that it can be driven.

    Args:
        file: Path of the CARLA route file.
        network: Network of the imported town.
        name: Name of the benchmark; None: that of the file.
        town: Town whose routes are imported; needed if the file has several towns.
        traffic: Traffic around every route, or amounts of traffic, a cell for each.
        conditions: Groups "train" and "test", a cell for each, or names of conditions, all in one cell.
        protocol: Rules by which agents are ranked.
        seeds: Seeds that are driven by default.
        max_snap_m: Largest distance from a waypoint to the nearest lane, m.
        skip: Whether routes that make no mission are left out; else they are an error.

    Raises:
        InvalidInputError: An invalid file, or routes that make no missions; the message names all bad places.
    """
    routes = _of_one_town(read_routes(file), town, file)
    roads = _Roads(load_network(network), max_snap_m)
    fitted, bad = _fit_all(roads, routes)
    if not fitted or (bad and not skip):
        reasons = "; ".join(f"route {route}: {reason}" for route, reason in bad.items())
        hint = "" if not fitted else "; --skip leaves them out"
        raise InvalidInputError(f"'{file}': {len(bad)} of {len(routes)} routes make no missions{hint}: {reasons}")
    made = make_cells(roads.network, network, fitted[0][0], traffic, conditions)
    try:
        benchmark = Benchmark(
            name=name or re.sub(r"[^\w-]+", "-", file.stem),
            description=f"{len(fitted)} CARLA routes from {file.name}{f', {routes[0].town}' if routes[0].town else ''}",
            cells=made.cells,
            missions={"all": tuple(ScriptedMission(**dict(mission)) for mission, _ in fitted)},
            seeds=tuple(seeds),
            **protocol.rules,
        )
    except ValidationError as error:
        raise InvalidInputError(f"'{file}': {describe_fault(error, Benchmark)}") from error
    return ImportedRoutes(benchmark, tuple(snap for _, snap in fitted), bad, made.reduced)


def _fit_all(roads: _Roads, routes: Sequence[CarlaRoute]) -> tuple[list[tuple[Mission, Snap]], dict[str, str]]:
    """Missions of the routes that can be driven, and the reasons of the others."""
    fitted, bad = [], {}
    for route in routes:
        try:
            mission, snap = roads.fit(route)
            plan_route(roads.network, mission)
        except InvalidInputError as error:
            bad[route.id] = str(error)
        else:
            fitted.append((mission, snap))
    return fitted, bad


def read_routes(file: Path) -> list[CarlaRoute]:
    """The routes of a file, in the order of the file.

    Raises:
        InvalidInputError: The file is missing or not a route file, or a route has fewer than two waypoints.
    """
    with tempfile.TemporaryDirectory(prefix="dohyo-routes-") as work:
        scan(file, "routes", copy=Path(work) / "routes.xml")
        root = ET.parse(Path(work) / "routes.xml").getroot()
    routes, faults = [], []
    for number, element in enumerate(root.iter("route")):
        try:
            routes.append(_route(element, number))
        except InvalidInputError as error:
            faults.append(str(error))
    if faults:
        raise InvalidInputError(f"'{file}': {'; '.join(faults)}")
    if not routes:
        raise InvalidInputError(f"'{file}' has no <route>")
    return routes


def net_offset(network: RoadNetwork) -> tuple[float, float]:
    """Offset from the coordinates of the source to those of the network, m.

    Raises:
        InvalidInputError: The net has no offset.
    """
    offset = read_offset(network.path)
    if offset is None:
        raise InvalidInputError(f"network '{network.name}': its net has no <location netOffset>")
    return offset


def _route(element: ET.Element, number: int) -> CarlaRoute:
    name = element.get("id", str(number))
    points = next((found for found in map(element.findall, WAYPOINTS) if found), [])
    try:
        waypoints = np.array([(float(point.attrib["x"]), float(point.attrib["y"])) for point in points])
    except (KeyError, ValueError) as error:
        raise InvalidInputError(f"route {name}: every waypoint needs numbers x and y, got {error}") from error
    if len(points) < 2 or not np.isfinite(waypoints).all():
        inside = ", ".join(sorted({f"<{child.tag}>" for child in element})) or "nothing"
        raise InvalidInputError(
            f"route {name}: expected two or more finite waypoints, got {len(points)}; they are <waypoint>, also in an "
            f"<ego_vehicle>, or <position> in <waypoints>, and the route holds {inside}"
        )
    return CarlaRoute(name, element.get("town") or element.get("map") or "", waypoints)


def _of_one_town(routes: Sequence[CarlaRoute], town: str | None, file: Path) -> list[CarlaRoute]:
    towns = sorted({route.town for route in routes})
    if town is None and len(towns) > 1:
        raise InvalidInputError(f"'{file}' has routes of {', '.join(map(repr, towns))}: choose one with --town")
    chosen = [route for route in routes if town is None or route.town == town]
    if not chosen:
        raise InvalidInputError(f"'{file}' has no route of '{town}', only of {', '.join(map(repr, towns))}")
    return chosen


@dataclass(frozen=True, slots=True)
class _End:
    """Start or goal of a route.

    Attributes:
        lane: Its lane, outside junctions.
        place: Its place on the lane.
        note: How it was moved out of a junction; "" if it was not.
    """

    lane: int
    place: Place
    note: str = ""


class _Roads:
    """Snaps points to the drivable lanes of a network."""

    def __init__(self, network: RoadNetwork, max_snap_m: float) -> None:
        self.network, self.max_snap_m = network, max_snap_m
        self.offset = np.array(net_offset(network))

    @cached_property
    def lanes(self) -> IntArray:
        return np.flatnonzero(self.network.lanes.drivable)

    @cached_property
    def lines(self) -> Any:
        return np.array([shapely.linestrings(self.network.lane_shape(lane)) for lane in self.lanes.tolist()])

    @cached_property
    def tree(self) -> shapely.STRtree:
        return shapely.STRtree(self.lines)

    def fit(self, route: CarlaRoute) -> tuple[Mission, Snap]:
        """The mission that follows a route; ends inside junctions are moved out of them.

        Raises:
            InvalidInputError: Waypoints are too far from every lane; the message names all of them.
        """
        points = route.waypoints * (1.0, -1.0) + self.offset
        near = [self._near(point) for point in points]
        far = [
            f"waypoint {number}: {self._to_nearest(point):.1f} m from the nearest drivable lane of "
            f"'{self.network.name}', {self.max_snap_m:g} m are allowed"
            for number, (point, lanes) in enumerate(zip(points, near, strict=True), start=1)
            if not lanes
        ]
        if far:
            raise InvalidInputError("; ".join(far))
        start = self._end("start", points[0], near[0], near[1:])
        goal = self._end("goal", points[-1], near[-1], near[-2::-1])
        inner = [lanes[0] for lanes in near[1:-1] if not self.network.lanes.internal[lanes[0]]]
        mission = Mission(
            name=f"route-{route.id}",
            start=start.place,
            goal=goal.place,
            via=self._via([start.lane, *inner, goal.lane]),
        )
        found = [start.lane, *(lanes[0] for lanes in near[1:-1]), goal.lane]
        moved = tuple(round(self._distance(*one), 3) for one in zip(found, points, strict=True))
        notes = tuple(end.note for end in (start, goal) if end.note)
        return mission, Snap(mission.name, moved, len(found) - 2 - len(inner), notes)

    def _near(self, point: FloatArray) -> list[int]:
        """Drivable lanes within the allowed distance of a point, the nearest first."""
        spot = shapely.points(point)
        found = self.tree.query(spot, predicate="dwithin", distance=self.max_snap_m)
        distance = shapely.distance(self.lines[found], spot)
        return [int(lane) for lane in self.lanes[found[np.argsort(distance, kind="stable")]]]

    def _to_nearest(self, point: FloatArray) -> float:
        return float(shapely.distance(self.lines, shapely.points(point)).min())

    def _distance(self, lane: int, point: FloatArray) -> float:
        return float(shapely.distance(shapely.linestrings(self.network.lane_shape(lane)), shapely.points(point)))

    def _end(self, what: str, point: FloatArray, near: Sequence[int], others: Sequence[Sequence[int]]) -> _End:
        """Place of a start or a goal.

        Args:
            what: "start" or "goal".
            point: (2,) x, y, m.
            near: Lanes near it, the nearest first.
            others: Lanes near the other waypoints, from this end on.
        """
        internal = self.network.lanes.internal
        outside = [lane for lane in near if not internal[lane]]
        at_least = self._distance(near[0], point)
        if outside and self._distance(outside[0], point) <= at_least + AT_BORDER_M:
            return _End(outside[0], self._place(outside[0], point))
        roads = {self.network.edge_id(lane) for lanes in others for lane in lanes[:1]}
        ways = [self._out_of_junction(lane, forward=what == "start") for lane in near if internal[lane]]
        lane = next((way for way in ways if self.network.edge_id(way) in roads), ways[0])
        length = float(self.network.lanes.length[lane])
        room = min(OUT_OF_JUNCTION_M, length / 2)
        place = Place(
            lane=str(self.network.lanes.ids[lane]), position_m=round(room if what == "start" else length - room, 2)
        )
        moved = float(np.hypot(*(np.array(self.network.lane_point(lane, place.position_m)[:2]) - point)))
        return _End(lane, place, f"{what} moved by {moved:.1f} m out of a junction")

    def _out_of_junction(self, lane: int, forward: bool) -> int:
        """The first lane outside the junction after, or before, a lane inside it."""
        connections = self.network.connections
        here, there = (connections.source, connections.target) if forward else (connections.target, connections.source)
        while self.network.lanes.internal[lane]:
            lane = int(there[np.flatnonzero(here == lane)[0]])
        return lane

    def _place(self, lane: int, point: FloatArray) -> Place:
        line = shapely.linestrings(self.network.lane_shape(lane))
        length = float(self.network.lanes.length[lane])
        share = float(shapely.line_locate_point(line, shapely.points(point), normalized=True))
        position = min(max(share * length, 0.0), length - END_ROOM_M) if length > END_ROOM_M else 0.0
        return Place(lane=str(self.network.lanes.ids[lane]), position_m=round(position, 2))

    def _via(self, lanes: Sequence[int]) -> tuple[str, ...]:
        """Edges between those of the first and the last lane, without immediate repetition."""
        edges = [self.network.edge_id(lane) for lane in lanes]
        changes = [edge for edge, before in zip(edges[1:], edges[:-1], strict=True) if edge != before]
        return tuple(changes[:-1] if changes and changes[-1] == edges[-1] else changes)
