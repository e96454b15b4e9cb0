"""Lanes: the map around the ego, as polylines."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from gymnasium.spaces import Box
from numba import njit

from dohyo.sumo_networks.arrays import Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.sensors.base import Sensor, Track
from dohyo.sumo_networks.world import World

ROWS = 160
POINTS = 20
ATTRIBUTES = 12
COLUMNS = ATTRIBUTES + 2 * POINTS
RADIUS_M = 100.0
PIECE_M = 40.0
FOLLOWERS = 5
ROAD, JUNCTION, CROSSING = 0, 1, 2


class LanesSensor(Sensor):
    """(160, 52) pieces of lanes, at most 40 m long, within 100 m of the ego, nearest first.

    Columns: lane (a number, stable in the network), piece (0 is the first), kind (0 road, 1 inside a junction,
    2 pedestrian crossing), width [m], speed limit [m/s], on the route (2 the route's own lane, 1 another lane of the
    route's roads, 0 neither), signal (`world.LightState` of the connection that leads into a lane inside a junction,
    -1 if there is none), lanes that follow the lane's last piece (5 columns, -1 unused); then 20 points x, y [m, ego
    frame: centre, x forward, y left] along the piece, in driving direction. Unused rows have lane -1 and zeros.
    """

    name = "lanes"
    track = Track.MAP
    space = Box(-np.inf, np.inf, (ROWS, COLUMNS), np.float32)

    def __init__(self) -> None:
        self._route: Route | None = None
        self._on_route: IntArray = np.zeros(0, dtype=np.int64)

    def read(self, world: World, ego: int) -> Float32Array:
        """Reads the array; see the class."""
        table, route = pieces(world.network), world.routes[ego]
        if route is not self._route:
            self._route, self._on_route = route, _on_route(world.network, route)
        x, y = world.egos.position[ego]
        rows = _nearest(float(x), float(y), RADIUS_M, table.points, table.centre, table.reach)
        out = np.zeros((ROWS, COLUMNS), dtype=np.float32)
        out[:, 0] = -1.0
        count, lane = len(rows), table.lane[rows]
        signal = table.signal[rows]
        out[:count, :5] = table.attributes[rows]
        out[:count, 5] = self._on_route[lane]
        out[:count, 6] = np.where(signal >= 0, world.signals[signal], -1) if len(world.signals) else -1.0
        out[:count, 7:ATTRIBUTES] = table.followers[rows]
        _into_ego_frame(float(x), float(y), float(world.egos.heading[ego]), table.points, rows, out)
        return out


@dataclass(frozen=True, slots=True)
class Pieces:
    """N pieces of the lanes of a network.

    Attributes:
        lane: (N,) index into `RoadNetwork.lanes`.
        attributes: (N, 5) lane, piece, kind, width [m], limit [m/s].
        signal: (N,) index of the signal of the connection that leads into the lane, -1 if none.
        followers: (N, 5) lanes that follow, -1 unused; set only on a lane's last piece.
        points: (N, 20, 2), m, network frame.
        centre: (N, 2), m.
        reach: (N,) distance from the centre to the farthest point, m.
    """

    lane: IntArray
    attributes: FloatArray
    signal: IntArray
    followers: IntArray
    points: FloatArray
    centre: FloatArray
    reach: FloatArray


@lru_cache(maxsize=8)
def pieces(network: RoadNetwork) -> Pieces:
    """Cuts all lanes open to cars, and all pedestrian crossings."""
    lanes = network.lanes
    signal, followers = _signals(network), _followers(network)
    owner, attributes, after, points = [], [], [], []
    for lane in np.flatnonzero(lanes.drivable | lanes.crossing).tolist():
        shape = network.lane_shape(lane)
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(shape, axis=0).T))])
        count = max(math.ceil(arc[-1] / PIECE_M), 1)
        kind = CROSSING if lanes.crossing[lane] else JUNCTION if lanes.internal[lane] else ROAD
        for piece in range(count):
            at = np.linspace(arc[-1] * piece / count, arc[-1] * (piece + 1) / count, POINTS)
            points.append(np.column_stack([np.interp(at, arc, shape[:, i]) for i in (0, 1)]))
            owner.append(lane)
            attributes.append((lane, piece, kind, lanes.width[lane], lanes.speed[lane]))
            after.append(followers[lane] if piece == count - 1 else np.full(FOLLOWERS, -1))
    table = np.array(points)
    centre = table.mean(axis=1)
    return Pieces(
        lane=np.array(owner, dtype=np.int64),
        attributes=np.array(attributes, dtype=np.float64),
        signal=signal[owner],
        followers=np.array(after, dtype=np.int64),
        points=table,
        centre=centre,
        reach=np.hypot(*(table - centre[:, None]).transpose(2, 0, 1)).max(axis=1),
    )


def _signals(network: RoadNetwork) -> IntArray:
    """(L,) signal of the connection into each lane inside a junction, later parts of the passage included."""
    connections = network.connections
    signal = np.full(len(network.lanes.ids), -1, dtype=np.int64)
    for c in np.flatnonzero(connections.signal >= 0).tolist():
        lane = int(connections.target[c])
        while network.lanes.internal[lane] and signal[lane] < 0:
            signal[lane] = connections.signal[c]
            onward = network.connections_from(lane)
            if not onward:
                break
            lane = int(connections.target[onward[0]])
    return signal


def _followers(network: RoadNetwork) -> IntArray:
    """(L, 5) lanes that follow each lane, -1 unused."""
    out = np.full((len(network.lanes.ids), FOLLOWERS), -1, dtype=np.int64)
    for lane in range(len(out)):
        onward = [int(network.connections.target[c]) for c in network.connections_from(lane)]
        onward = [target for target in onward if network.lanes.drivable[target]][:FOLLOWERS]
        out[lane, : len(onward)] = onward
    return out


def _on_route(network: RoadNetwork, route: Route) -> IntArray:
    """(L,) 2 for the route's lanes, 1 for other lanes of its roads, 0 for the rest."""
    edges = np.unique(network.lanes.edge[route.on_route])
    beside = np.isin(network.lanes.edge, edges) & ~network.lanes.internal
    return np.where(route.on_route, 2, np.where(beside, 1, 0))


@njit(cache=True)
def _nearest(x: float, y: float, radius: float, points: FloatArray, centre: FloatArray, reach: FloatArray) -> IntArray:
    """Pieces with a point within a radius, nearest first, at most ROWS."""
    found = np.empty(points.shape[0], dtype=np.int64)
    distance = np.empty(points.shape[0])
    count = 0
    for i in range(points.shape[0]):
        if math.hypot(centre[i, 0] - x, centre[i, 1] - y) > radius + reach[i]:
            continue
        least = math.inf
        for p in range(points.shape[1]):
            dx, dy = points[i, p, 0] - x, points[i, p, 1] - y
            least = min(least, dx * dx + dy * dy)
        if least <= radius * radius:
            found[count], distance[count] = i, least
            count += 1
    order = np.argsort(distance[:count], kind="mergesort")[:ROWS]
    return found[order]


@njit(cache=True)
def _into_ego_frame(x: float, y: float, heading: float, points: FloatArray, rows: IntArray, out: Float32Array) -> None:
    cos, sin = math.cos(heading), math.sin(heading)
    for row in range(rows.shape[0]):
        for p in range(points.shape[1]):
            dx, dy = points[rows[row], p, 0] - x, points[rows[row], p, 1] - y
            out[row, ATTRIBUTES + 2 * p] = dx * cos + dy * sin
            out[row, ATTRIBUTES + 2 * p + 1] = dy * cos - dx * sin
