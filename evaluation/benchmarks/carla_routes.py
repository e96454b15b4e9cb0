"""CARLA route files: their waypoints, snapped to the lanes of an imported town, as the missions of a benchmark.

CARLA's frame is left-handed: y grows to the right of x, so it is the negative of OpenDRIVE's y. netconvert moves a town
by an offset, which the net records. Source: CARLA Leaderboard, route files of versions 1 and 2.
"""

from __future__ import annotations

import gzip
import re
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from pydantic import ValidationError

from dohyo.evaluation.benchmarks.benchmark import Benchmark, Cell
from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.networks.xml_guard import scan
from dohyo.sumo_networks.scenario import Mission, Place, Traffic

MAX_SNAP_M = 5.0
METRIC = "driving score: route completion times infraction penalty, mean over drives (CARLA Leaderboard 2.0)"
# An ego is placed by the centre of its box; nearer to the start of a lane its rear would be in the junction.
END_ROOM_M = 0.1


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
    """

    mission: str
    moved_m: tuple[float, ...]
    unused: int

    @property
    def mean_m(self) -> float:
        """Mean distance, m."""
        return float(np.mean(self.moved_m))

    def as_document(self) -> dict[str, Any]:
        """The result as plain JSON."""
        return {"mission": self.mission, "moved_m": list(self.moved_m), "unused": self.unused}


def import_routes(
    file: Path,
    network: str,
    *,
    name: str | None = None,
    town: str | None = None,
    traffic: Traffic | None = None,
    max_snap_m: float = MAX_SNAP_M,
) -> tuple[Benchmark, list[Snap]]:
    """A benchmark with one mission per route; planning each of them once shows that it can be driven.

    Args:
        file: Path of the CARLA route file.
        network: Network of the imported town.
        name: Name of the benchmark; None: that of the file.
        town: Town whose routes are imported; needed if the file has several towns.
        traffic: Traffic around every route; None: no traffic.
        max_snap_m: Largest distance from a waypoint to the nearest lane, m.

    Raises:
        InvalidInputError: An invalid file, a waypoint off the road, or a route that cannot be driven.
    """
    routes = _of_one_town(read_routes(file), town, file)
    roads = _Roads(load_network(network), max_snap_m)
    fitted = [roads.fit(route) for route in routes]
    try:
        benchmark = Benchmark(
            name=name or re.sub(r"[^\w-]+", "-", file.stem),
            description=f"{len(routes)} CARLA routes from {file.name}{f', {routes[0].town}' if routes[0].town else ''}",
            headline=Headline.DRIVING_SCORE,
            metric=METRIC,
            cells=(Cell(name="all", network=network, missions="all", traffic=traffic or Traffic()),),
            missions={"all": tuple(mission for mission, _ in fitted)},
        )
    except ValidationError as error:
        raise InvalidInputError(f"'{file}': {error.errors()[0]['msg']}") from error
    benchmark.scenarios(seeds=(0,))
    return benchmark, [snap for _, snap in fitted]


def read_routes(file: Path) -> list[CarlaRoute]:
    """The routes of a file, in the order of the file.

    Raises:
        InvalidInputError: The file is missing or not a route file, or a route has fewer than two waypoints.
    """
    with tempfile.TemporaryDirectory(prefix="dohyo-routes-") as work:
        scan(file, "routes", copy=Path(work) / "routes.xml")
        root = ET.parse(Path(work) / "routes.xml").getroot()
    routes = [_route(element, number, file) for number, element in enumerate(root.iter("route"))]
    if not routes:
        raise InvalidInputError(f"'{file}' has no <route>")
    return routes


def net_offset(network: RoadNetwork) -> tuple[float, float]:
    """Offset from the coordinates of the source to those of the network, m.

    Raises:
        InvalidInputError: The net has no offset.
    """
    with gzip.open(network.path, "rb") if network.path.suffix == ".gz" else network.path.open("rb") as file:
        head = file.read(1 << 18)
    match = re.search(rb'<location\b[^>]*\bnetOffset="(-?[\d.]+),(-?[\d.]+)"', head)
    if not match:
        raise InvalidInputError(f"network '{network.name}': its net has no <location netOffset>")
    return float(match[1]), float(match[2])


def _route(element: ET.Element, number: int, file: Path) -> CarlaRoute:
    name = element.get("id", str(number))
    points = element.findall("waypoints/position") or element.findall("waypoint")
    try:
        waypoints = np.array([(float(point.attrib["x"]), float(point.attrib["y"])) for point in points])
    except (KeyError, ValueError) as error:
        raise InvalidInputError(f"'{file}', route {name}: every waypoint needs numbers x and y, got {error}") from error
    if len(points) < 2 or not np.isfinite(waypoints).all():
        raise InvalidInputError(f"'{file}', route {name}: expected two or more finite waypoints, got {len(points)}")
    return CarlaRoute(name, element.get("town") or element.get("map") or "", waypoints)


def _of_one_town(routes: Sequence[CarlaRoute], town: str | None, file: Path) -> list[CarlaRoute]:
    towns = sorted({route.town for route in routes})
    if town is None and len(towns) > 1:
        raise InvalidInputError(f"'{file}' has routes of {', '.join(map(repr, towns))}: choose one with --town")
    chosen = [route for route in routes if town is None or route.town == town]
    if not chosen:
        raise InvalidInputError(f"'{file}' has no route of '{town}', only of {', '.join(map(repr, towns))}")
    return chosen


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
        """The mission that follows a route.

        Raises:
            InvalidInputError: A waypoint is too far from every lane, or the start or goal is inside a junction.
        """
        points = route.waypoints * (1.0, -1.0) + self.offset
        last = len(points) - 1
        found = [self._nearest(route, number, point, number in (0, last)) for number, point in enumerate(points)]
        start, goal = self._place(found[0][0], points[0]), self._place(found[-1][0], points[-1])
        inner = [lane for lane, _ in found[1:-1] if not self.network.lanes.internal[lane]]
        via = self._via([found[0][0], *inner, found[-1][0]])
        name = f"route-{route.id}"
        mission = Mission(name=name, start=start, goal=goal, via=via)
        moved = tuple(round(distance, 3) for _, distance in found)
        return mission, Snap(name, moved, len(found) - 2 - len(inner))

    def _nearest(self, route: CarlaRoute, number: int, point: FloatArray, outside: bool) -> tuple[int, float]:
        """The nearest lane and its distance; only lanes outside junctions at the ends of a route."""
        where = f"route {route.id}, waypoint {number + 1}"
        spot = shapely.points(point)
        near = self.tree.query(spot, predicate="dwithin", distance=self.max_snap_m)
        if not len(near):
            away = float(shapely.distance(self.lines, spot).min())
            raise InvalidInputError(
                f"{where}: {away:.1f} m from the nearest drivable lane of '{self.network.name}', "
                f"{self.max_snap_m:g} m are allowed"
            )
        if outside:
            near = near[~self.network.lanes.internal[self.lanes[near]]]
            if not len(near):
                raise InvalidInputError(f"{where}: inside a junction; a route must start and end outside")
        distance = shapely.distance(self.lines[near], spot)
        best = int(np.argmin(distance))
        return int(self.lanes[near[best]]), float(distance[best])

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
