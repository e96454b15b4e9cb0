"""Background traffic: who drives, cycles and walks where. Decides; the simulation carries out."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, Protocol

import numpy as np

from sumo_networks.arrays import BoolArray, FloatArray, IntArray
from sumo_networks.errors import InvalidInputError
from sumo_networks.network import RoadNetwork
from sumo_networks.scenario import Traffic
from sumo_networks.world import SIGHT_M

VEHICLE_TYPES = ("car", "van", "truck", "bus")
VEHICLE_SHARES = (0.84, 0.08, 0.04, 0.04)
ATTEMPTS = 30


@dataclass(frozen=True, slots=True)
class Trip:
    """One journey of one vehicle or bicycle.

    Attributes:
        type: A vType of vehicle_types.add.xml.
        edges: SUMO edge ids, connected.
        on_the_way: Whether it starts somewhere along its first edge (at the beginning of an episode), not at its start.
    """

    type: str
    edges: tuple[str, ...]
    on_the_way: bool


@dataclass(frozen=True, slots=True)
class Walk:
    """One journey of one pedestrian, between two edges with sidewalks.

    Attributes:
        source: SUMO edge id.
        source_m: Where on it, m.
        target: SUMO edge id.
        target_m: Where on it, m.
    """

    source: str
    source_m: float
    target: str
    target_m: float


class Stage(Protocol):
    """What the population asks of the simulation."""

    def add_vehicle(self, name: str, trip: Trip) -> None:
        """Lets a vehicle depart as soon as there is room."""

    def add_pedestrian(self, name: str, walk: Walk) -> bool:
        """Lets a pedestrian set out; False if there is no way on foot."""

    def arrived(self) -> tuple[Sequence[str], Sequence[str]]:
        """Names of the vehicles and of the pedestrians that reached their goal in the last tick."""


class Population:
    """Keeps the number of vehicles, bicycles and pedestrians constant.

    Newcomers enter at the edges of the network where it has any, and away from the egos where that is possible.
    """

    def __init__(self, network: RoadNetwork, traffic: Traffic, rng: np.random.Generator) -> None:
        self.network, self.traffic, self.rng = network, traffic, rng
        self._count = 0

    def fill(self, stage: Stage) -> None:
        """Puts the whole population on the road, spread over the network."""
        nowhere = np.empty((0, 2))
        for _ in range(self.traffic.vehicles):
            stage.add_vehicle(self._name("vehicle"), self._vehicle_trip(nowhere, on_the_way=True))
        for _ in range(self.traffic.bicycles):
            stage.add_vehicle(self._name("bicycle"), self._bicycle_trip(nowhere, on_the_way=True))
        for _ in range(self.traffic.pedestrians):
            self._send_pedestrian(stage, nowhere)

    def replace_arrived(self, stage: Stage, egos: FloatArray) -> None:
        """Sends one newcomer for everyone who arrived in the last tick.

        Args:
            stage: The simulation.
            egos: (E, 2), m, where newcomers should not appear.
        """
        self.replace(stage, *stage.arrived(), egos)

    def replace(self, stage: Stage, vehicles: Sequence[str], pedestrians: Sequence[str], egos: FloatArray) -> None:
        """Sends one newcomer for each of the named; names of others, such as egos, are ignored.

        Args:
            stage: The simulation.
            vehicles: Names of vehicles and bicycles.
            pedestrians: Names.
            egos: (E, 2), m, where newcomers should not appear.
        """
        for name in vehicles:
            if name.startswith("vehicle"):
                stage.add_vehicle(self._name("vehicle"), self._vehicle_trip(egos, on_the_way=False))
            elif name.startswith("bicycle"):
                stage.add_vehicle(self._name("bicycle"), self._bicycle_trip(egos, on_the_way=False))
        for _ in pedestrians:
            self._send_pedestrian(stage, egos)

    def _name(self, kind: str) -> str:
        self._count += 1
        return f"{kind}-{self._count}"

    def _vehicle_trip(self, egos: FloatArray, on_the_way: bool) -> Trip:
        kind = VEHICLE_TYPES[int(self.rng.choice(len(VEHICLE_TYPES), p=VEHICLE_SHARES))]
        return Trip(kind, edge_graph(self.network, "drivable").random_path(self.rng, egos, on_the_way), on_the_way)

    def _bicycle_trip(self, egos: FloatArray, on_the_way: bool) -> Trip:
        path = edge_graph(self.network, "bicycle").random_path(self.rng, egos, on_the_way)
        return Trip("bicycle", path, on_the_way)

    def _send_pedestrian(self, stage: Stage, egos: FloatArray) -> None:
        for attempt in range(ATTEMPTS):
            # What is out of the egos' sight may be an island.
            avoided = egos if attempt < ATTEMPTS // 2 else np.empty((0, 2))
            walk = sidewalks(self.network).random_walk(self.rng, avoided)
            if stage.add_pedestrian(self._name("pedestrian"), walk):
                return


class EdgeGraph:
    """Edges open to one kind of vehicle, and the fastest ways between them."""

    def __init__(self, network: RoadNetwork, permission: BoolArray) -> None:
        lanes = network.lanes
        normal = permission & ~lanes.internal & ~lanes.crossing & (lanes.length > 0)
        self.edges = np.unique(lanes.edge[normal])
        self.names = [str(lanes.edge_ids[e]) for e in self.edges]
        row = {int(e): i for i, e in enumerate(self.edges)}
        first = {int(lanes.edge[lane]): int(lane) for lane in np.flatnonzero(normal)[::-1]}
        self.length = np.array([lanes.length[first[int(e)]] for e in self.edges])
        self.time = self.length / np.array([lanes.speed[first[int(e)]] for e in self.edges])
        self.start = np.array([network.lane_shape(first[int(e)])[0] for e in self.edges])
        self.lane_count = np.bincount([row[int(e)] for e in lanes.edge[normal]], minlength=len(self.edges))
        self.next = _followers(network, permission, normal, row)
        incoming = np.zeros(len(self.edges), dtype=np.int64)
        for followers in self.next:
            incoming[followers] += 1
        self.sources = np.flatnonzero(incoming == 0)
        self.sinks = np.array([i for i, followers in enumerate(self.next) if not followers], dtype=np.int64)
        self._trees: dict[int, IntArray] = {}

    def random_path(self, rng: np.random.Generator, egos: FloatArray, on_the_way: bool) -> tuple[str, ...]:
        """A random journey, as edge ids, that begins out of the egos' sight where the network is large enough.

        Raises:
            InvalidInputError: No two edges are connected, nor does any lead through the whole network.
        """
        everywhere = np.arange(len(self.edges))
        sources = everywhere if on_the_way or not len(self.sources) else self.sources
        sinks = self.sinks if len(self.sinks) else everywhere
        sources = sources[out_of_sight(self.start[sources], egos)]
        weight = self.lane_count[sources] * (self.length[sources] if on_the_way else 1.0)
        for _ in range(ATTEMPTS if len(sources) else 0):
            source = int(rng.choice(sources, p=weight / weight.sum()))
            sink = int(rng.choice(sinks, p=self.lane_count[sinks] / self.lane_count[sinks].sum()))
            path = self._path(source, sink) if source != sink else []
            if path:
                return tuple(self.names[i] for i in path)
        alone = np.intersect1d(np.intersect1d(sources, self.sources), self.sinks)
        if len(alone):  # a road that meets no other, such as a stretch of motorway
            return (self.names[int(rng.choice(alone, p=self.lane_count[alone] / self.lane_count[alone].sum()))],)
        if len(egos):
            return self.random_path(rng, np.empty((0, 2)), on_the_way)
        raise InvalidInputError("traffic: the network has no two connected edges for its vehicles to drive between")

    def _path(self, source: int, sink: int) -> list[int]:
        parents = self._trees.get(source)
        if parents is None:
            parents = self._trees[source] = self._tree(source)
        if parents[sink] < 0:
            return []
        path = [sink]
        while path[-1] != source:
            path.append(int(parents[path[-1]]))
        return path[::-1]

    def _tree(self, source: int) -> IntArray:
        """(N,) predecessor of every edge on the fastest way from the source, -1 where there is none."""
        parents = np.full(len(self.edges), -1, dtype=np.int64)
        best = np.full(len(self.edges), np.inf)
        best[source] = 0.0
        frontier = [(0.0, source)]
        while frontier:
            cost, i = heapq.heappop(frontier)
            if cost > best[i]:
                continue
            for j in self.next[i]:
                through = cost + self.time[i]
                if through < best[j]:
                    best[j], parents[j] = through, i
                    heapq.heappush(frontier, (through, j))
        return parents


def out_of_sight(places: FloatArray, egos: FloatArray) -> IntArray:
    """Rows of the places (N, 2) [m] that no ego can see; where all are in sight, that of the farthest."""
    if not len(egos):
        return np.arange(len(places))
    distance = np.hypot(*(places[:, None] - egos).T).min(axis=0)
    hidden = np.flatnonzero(distance > SIGHT_M)
    return hidden if len(hidden) else np.array([np.argmax(distance)])


def _followers(network: RoadNetwork, permission: BoolArray, normal: BoolArray, row: dict[int, int]) -> list[list[int]]:
    """Rows of the edges that follow each edge, without turning round."""
    lanes, connections = network.lanes, network.connections
    out: list[set[int]] = [set() for _ in row]
    for c in range(len(connections.source)):
        source, target = int(connections.source[c]), int(connections.target[c])
        if not normal[source] or connections.direction[c] == "t":
            continue
        while lanes.internal[target] and permission[target]:
            onward = network.connections_from(target)
            if not onward:
                break
            target = int(connections.target[onward[0]])
        if normal[target]:
            out[row[int(lanes.edge[source])]].add(row[int(lanes.edge[target])])
    return [sorted(followers) for followers in out]


class Sidewalks:
    """Edges with a sidewalk."""

    def __init__(self, network: RoadNetwork) -> None:
        lanes = network.lanes
        walkable = lanes.pedestrian & ~lanes.internal & ~lanes.crossing & (lanes.length > 3.0)
        walkable &= np.array([not str(edge).startswith(":") for edge in lanes.edge_ids])[lanes.edge]
        self.lanes = np.flatnonzero(walkable)
        self.names = [network.edge_id(int(lane)) for lane in self.lanes]
        self.length = lanes.length[self.lanes]
        self.middle = np.array([network.lane_shape(int(lane)).mean(axis=0) for lane in self.lanes])

    def random_walk(self, rng: np.random.Generator, egos: FloatArray) -> Walk:
        """A random way on foot; its start is away from the egos where that is possible."""
        weight = self.length / self.length.sum()
        hidden = out_of_sight(self.middle, egos)
        a = int(hidden[rng.choice(len(hidden), p=weight[hidden] / weight[hidden].sum())])
        b = int(rng.choice(len(self.lanes), p=weight))
        at = rng.uniform(0.05, 0.95, size=2) * self.length[[a, b]]
        return Walk(self.names[a], float(at[0]), self.names[b], float(at[1]))


@lru_cache(maxsize=16)
def edge_graph(network: RoadNetwork, kind: Literal["drivable", "bicycle"]) -> EdgeGraph:
    """The edges open to cars or to bicycles, built once per network."""
    return EdgeGraph(network, getattr(network.lanes, kind))


@lru_cache(maxsize=16)
def sidewalks(network: RoadNetwork) -> Sidewalks:
    """The network's sidewalks, found once.

    Raises:
        InvalidInputError: It has none.
    """
    found = Sidewalks(network)
    if not len(found.lanes):
        raise InvalidInputError(f"traffic: network '{network.name}' has no sidewalk, so pedestrians must be 0")
    return found
