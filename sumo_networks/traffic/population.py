"""Background traffic: vehicles, bicycles and pedestrians with random journeys, as requests to the simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache

import numpy as np

from dohyo.sumo_networks.actors.names import Role, numbered, role_of
from dohyo.sumo_networks.actors.requests import Request, SpawnPedestrian, SpawnVehicle, Walk
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.edge_graph import ATTEMPTS, draw, edge_graph, out_of_sight
from dohyo.sumo_networks.scenario import Traffic
from dohyo.sumo_networks.traffic.flows import FlowSource, make_flow_sources
from dohyo.sumo_networks.units import TICK_S

VEHICLE_TYPES = ("car", "van", "truck", "bus")
VEHICLE_SHARES = (0.84, 0.08, 0.04, 0.04)
NOWHERE: FloatArray = np.empty((0, 2))
"""No points to keep away from."""
WayOnFoot = Callable[[Walk], tuple[str, ...]]
"""Query: SUMO edge ids of the path of a walk; empty if there is none."""
ClosedTo = Callable[[str], frozenset[int]]
"""Query: lanes that are open to cars and closed to a type of vehicle."""


def closed_to_nobody(kind: str) -> frozenset[int]:
    """No lanes: every type may drive where cars may."""
    return frozenset()


class Population:
    """Keeps the number of vehicles, bicycles and pedestrians constant, and sends the vehicles of flows.

    New vehicles and pedestrians enter at the borders of the network if it has any, and away from the egos if possible;
    vehicles of a flow enter at the flow's source. Every method yields its requests one by one, and the caller applies
    each before it takes the next: whether a pedestrian has a path decides the next random draw.
    """

    def __init__(
        self,
        network: RoadNetwork,
        traffic: Traffic,
        rng: np.random.Generator,
        way_on_foot: WayOnFoot,
        closed_to: ClosedTo = closed_to_nobody,
    ) -> None:
        """Finds the paths of the flows.

        Raises:
            InvalidInputError: A flow has no path.
        """
        self.network, self.traffic, self.rng = network, traffic, rng
        self._way_on_foot, self._closed_to = way_on_foot, closed_to
        self._count = self._ticks = 0
        self._streams = make_flow_sources(network, traffic.flows, rng)

    def fill(self) -> Iterator[Request]:
        """Yields the whole population, spread over the network.

        Raises:
            InvalidInputError: Nobody can drive or walk here, or the vehicles of a flow may not drive to its target.
        """
        for number, stream in enumerate(self._streams):
            if stream.type and not self._flow_path(stream, stream.type):
                source, target = stream.edges[0], stream.edges[-1]
                raise InvalidInputError(
                    f"traffic.flows[{number}]: no path that is open to a {stream.type} leads from edge '{source}' to "
                    f"edge '{target}'"
                )
        for _ in range(self.traffic.vehicles):
            yield self._vehicle(NOWHERE, on_the_way=True)
        for _ in range(self.traffic.bicycles):
            yield self._bicycle(NOWHERE, on_the_way=True)
        for _ in range(self.traffic.pedestrians - self.traffic.jaywalker_count):
            yield from self._pedestrian(NOWHERE)

    def update(self, vehicles: Sequence[str], pedestrians: Sequence[str], egos: FloatArray) -> Iterator[Request]:
        """Advances one tick: a new actor for each that arrived in the last tick, and the vehicles of the flows.

        Args:
            vehicles: Names of the vehicles and bicycles that arrived.
            pedestrians: Names of the pedestrians that arrived.
            egos: (E, 2), m, points near which no actor should appear.
        """
        yield from self.replace(vehicles, pedestrians, egos)
        self._ticks += 1
        for stream in self._streams:
            for _ in stream.due(self._ticks * TICK_S):
                kind = stream.type or self._vehicle_type()
                lane = "best" if stream.lane is None else str(stream.lane)
                edges = self._flow_path(stream, kind)
                if not edges:  # of a mixed flow
                    kind, edges = "car", stream.edges
                yield SpawnVehicle(self._name(Role.FLOW), kind, edges, lane)

    def replace(self, vehicles: Sequence[str], pedestrians: Sequence[str], egos: FloatArray) -> Iterator[Request]:
        """Yields one new actor for each name; names of others, such as egos, are ignored.

        Args:
            vehicles: Names of vehicles and bicycles.
            pedestrians: Names of pedestrians.
            egos: (E, 2), m, points near which no actor should appear.
        """
        for name in vehicles:
            role = role_of(name)
            if role is Role.VEHICLE:
                yield self._vehicle(egos, on_the_way=False)
            elif role is Role.BICYCLE:
                yield self._bicycle(egos, on_the_way=False)
        for _ in pedestrians:
            yield from self._pedestrian(egos)

    def _name(self, role: Role) -> str:
        self._count += 1
        return numbered(role, self._count)

    def _vehicle(self, egos: FloatArray, on_the_way: bool) -> SpawnVehicle:
        name, kind = self._name(Role.VEHICLE), self._vehicle_type()
        try:
            edges = edge_graph(self.network, "drivable", self._closed(kind)).random_path(self.rng, egos, on_the_way)
        except InvalidInputError:
            # Where no road is open to a truck, a car comes instead.
            kind, edges = "car", edge_graph(self.network, "drivable").random_path(self.rng, egos, on_the_way)
        return _entering(name, kind, edges, on_the_way)

    def _bicycle(self, egos: FloatArray, on_the_way: bool) -> SpawnVehicle:
        edges = edge_graph(self.network, "bicycle").random_path(self.rng, egos, on_the_way)
        return _entering(self._name(Role.BICYCLE), "bicycle", edges, on_the_way)

    def _closed(self, kind: str) -> frozenset[int]:
        return frozenset() if kind in ("car", "bicycle") else self._closed_to(kind)

    def _flow_path(self, stream: FlowSource, kind: str) -> tuple[str, ...]:
        """Path of a type of vehicle in a flow; empty if it may not drive from source to target."""
        closed = self._closed(kind)
        if not closed:
            return stream.edges
        source, target = stream.edges[0], stream.edges[-1]
        entries = self.network.lanes_of_edge[source]
        if stream.lane is not None and entries[stream.lane] in closed:
            return ()
        return edge_graph(self.network, "drivable", closed).fastest(source, target)

    def _vehicle_type(self) -> str:
        return VEHICLE_TYPES[draw(self.rng, np.array(VEHICLE_SHARES))]

    def _pedestrian(self, egos: FloatArray) -> Iterator[SpawnPedestrian]:
        for attempt in range(ATTEMPTS):
            # Sidewalks out of the egos' sight may have no path to any other.
            avoided = egos if attempt < ATTEMPTS // 2 else NOWHERE
            walk, name = sidewalks(self.network).random_walk(self.rng, avoided), self._name(Role.PEDESTRIAN)
            if edges := self._way_on_foot(walk):
                yield SpawnPedestrian(name, walk, edges)
                return


def _entering(name: str, kind: str, edges: tuple[str, ...], on_the_way: bool) -> SpawnVehicle:
    """A vehicle that enters at the start of its first edge or, at the beginning of an episode, somewhere along it."""
    if on_the_way:
        return SpawnVehicle(name, kind, edges, position="random_free", speed="desired")
    return SpawnVehicle(name, kind, edges)


class Sidewalks:
    """Edges of a network with a sidewalk."""

    def __init__(self, network: RoadNetwork) -> None:
        lanes = network.lanes
        walkable = lanes.pedestrian & ~lanes.internal & ~lanes.crossing & (lanes.length > 3.0)
        walkable &= np.array([not str(edge).startswith(":") for edge in lanes.edge_ids])[lanes.edge]
        self.lanes = np.flatnonzero(walkable)
        self.names = [network.edge_id(int(lane)) for lane in self.lanes]
        self.length = lanes.length[self.lanes]
        self.middle = np.array([network.lane_shape(int(lane)).mean(axis=0) for lane in self.lanes])

    def random_walk(self, rng: np.random.Generator, egos: FloatArray) -> Walk:
        """Random walk between two edges; it starts away from the egos if possible."""
        weight = self.length / self.length.sum()
        hidden = out_of_sight(self.middle, egos)
        a, b = int(hidden[draw(rng, weight[hidden])]), draw(rng, self.length)
        at = rng.uniform(0.05, 0.95, size=2) * self.length[[a, b]]
        return Walk(self.names[a], float(at[0]), self.names[b], float(at[1]))


@lru_cache(maxsize=16)
def sidewalks(network: RoadNetwork) -> Sidewalks:
    """The network's sidewalks, found once.

    Raises:
        InvalidInputError: The network has no sidewalk.
    """
    found = Sidewalks(network)
    if not len(found.lanes):
        raise InvalidInputError(f"traffic: network '{network.name}' has no sidewalk, so pedestrians must be 0")
    return found
