"""EdgeGraph: the edges open to one kind of vehicle, and the paths between them."""

from __future__ import annotations

import heapq
from functools import lru_cache
from typing import Literal

import numpy as np

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.units import SIGHT_M

ATTEMPTS = 30


class EdgeGraph:
    """Edges open to one kind of vehicle, and the fastest paths between them."""

    def __init__(self, network: RoadNetwork, permission: BoolArray, borders: EdgeGraph | None = None) -> None:
        """Finds the edges and what follows them.

        Args:
            network: The road network.
            permission: (L,) lanes open to the kind.
            borders: Graph whose ends are the only ends, since there the road goes on for nobody; None: this one.
        """
        lanes = network.lanes
        normal = permission & ~lanes.internal & ~lanes.crossing & (lanes.length > 0)
        self.edges = np.unique(lanes.edge[normal])
        self.names = [str(lanes.edge_ids[e]) for e in self.edges]
        row = {int(e): i for i, e in enumerate(self.edges)}
        first = {int(lanes.edge[lane]): int(lane) for lane in np.flatnonzero(normal)[::-1]}
        self.length = np.array([lanes.length[first[int(e)]] for e in self.edges])
        self.time = self.length / np.array([lanes.speed[first[int(e)]] for e in self.edges])
        self.start = np.array([network.lane_shape(first[int(e)])[0] for e in self.edges]).reshape(-1, 2)
        self.lane_count = np.bincount([row[int(e)] for e in lanes.edge[normal]], minlength=len(self.edges))
        self.next = _followers(network, permission, normal, row)
        incoming = np.zeros(len(self.edges), dtype=np.int64)
        for followers in self.next:
            incoming[followers] += 1
        self.sources = np.flatnonzero(incoming == 0)
        self.sinks = np.array([i for i, followers in enumerate(self.next) if not followers], dtype=np.int64)
        if borders is not None:
            self.sources = self.sources[np.isin(self.edges[self.sources], borders.edges[borders.sources])]
            self.sinks = self.sinks[np.isin(self.edges[self.sinks], borders.edges[borders.sinks])]
        ends, everywhere = borders or self, np.arange(len(self.edges))
        self._entries = self.sources if len(ends.sources) else everywhere
        self._exits = self.sinks if len(ends.sinks) else everywhere
        self._trees: dict[int, IntArray] = {}

    def random_path(self, rng: np.random.Generator, egos: FloatArray, on_the_way: bool) -> tuple[str, ...]:
        """Random path as edge ids; it begins out of the egos' sight if the network is large enough.

        Raises:
            InvalidInputError: No two edges are connected, and no edge leads through the whole network.
        """
        sources, sinks = np.arange(len(self.edges)) if on_the_way else self._entries, self._exits
        sources = sources[out_of_sight(self.start[sources], egos)]
        weight = self.lane_count[sources] * (self.length[sources] if on_the_way else 1.0)
        for _ in range(ATTEMPTS if len(sources) and len(sinks) else 0):
            source = int(sources[draw(rng, weight)])
            sink = int(sinks[draw(rng, self.lane_count[sinks])])
            path = self._path(source, sink) if source != sink else []
            if path:
                return tuple(self.names[i] for i in path)
        alone = np.intersect1d(np.intersect1d(sources, self.sources), self.sinks)
        if len(alone):  # a road without junctions, such as a stretch of motorway
            return (self.names[int(alone[draw(rng, self.lane_count[alone])])],)
        if len(egos):
            return self.random_path(rng, np.empty((0, 2)), on_the_way)
        raise InvalidInputError("traffic: the network has no two connected edges for its vehicles to drive between")

    def fastest(self, source: str, target: str) -> tuple[str, ...]:
        """Fastest path between two edges, both included; empty if there is none or one of them is not open.

        Args:
            source: SUMO edge id.
            target: SUMO edge id; may be the source itself.
        """
        if source not in self.names or target not in self.names:
            return ()
        if source == target:
            return (source,)
        return tuple(self.names[i] for i in self._path(self.names.index(source), self.names.index(target)))

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
        """(N,) predecessor of every edge on the fastest path from the source, -1 if there is none."""
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


def draw(rng: np.random.Generator, weight: FloatArray | IntArray) -> int:
    """Draws a row with a probability in proportion to its weight: as `rng.choice`, ten times as fast."""
    cumulated = np.cumsum(weight / weight.sum())
    cumulated /= cumulated[-1]
    return int(cumulated.searchsorted(rng.random(), side="right"))


def out_of_sight(places: FloatArray, egos: FloatArray) -> IntArray:
    """Rows of the places (N, 2) [m] that no ego can see; if all are in sight, the row of the farthest place."""
    if not len(egos) or not len(places):
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


@lru_cache(maxsize=32)
def edge_graph(
    network: RoadNetwork, kind: Literal["drivable", "bicycle"], closed: frozenset[int] = frozenset()
) -> EdgeGraph:
    """The edges open to cars or to bicycles, built once per network.

    Args:
        network: The road network.
        kind: Field of `Lanes` that says which lanes are open.
        closed: Lanes that are closed all the same, such as those for cars only to trucks.
    """
    permission: BoolArray = getattr(network.lanes, kind)
    if not closed:
        return EdgeGraph(network, permission)
    open_to_all = edge_graph(network, kind)
    permission = permission.copy()
    permission[list(closed)] = False
    return EdgeGraph(network, permission, borders=open_to_all)
