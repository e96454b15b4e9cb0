"""Background traffic: who drives, cycles and walks where. Decides; the simulation carries out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.edge_graph import ATTEMPTS, draw, edge_graph, out_of_sight
from dohyo.sumo_networks.scenario import Traffic
from dohyo.sumo_networks.traffic.flows import make_flow_sources
from dohyo.sumo_networks.units import TICK_S

VEHICLE_TYPES = ("car", "van", "truck", "bus")
VEHICLE_SHARES = (0.84, 0.08, 0.04, 0.04)


@dataclass(frozen=True, slots=True)
class Trip:
    """One journey of one vehicle or bicycle.

    Attributes:
        type: A vType of vehicle_types.add.xml.
        edges: SUMO edge ids, connected.
        on_the_way: Whether it starts somewhere along its first edge (at the beginning of an episode), not at its start.
        lane: Index of the lane on which it enters; None: the best one.
    """

    type: str
    edges: tuple[str, ...]
    on_the_way: bool
    lane: int | None = None


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
    """Keeps the number of vehicles, bicycles and pedestrians constant, and the flows going.

    Newcomers enter at the edges of the network where it has any, and away from the egos where that is possible; those
    of a flow enter where the scenario says.
    """

    def __init__(self, network: RoadNetwork, traffic: Traffic, rng: np.random.Generator) -> None:
        """Finds the ways of the flows.

        Raises:
            InvalidInputError: One of them leads nowhere.
        """
        self.network, self.traffic, self.rng = network, traffic, rng
        self._count = self._ticks = 0
        self._streams = make_flow_sources(network, traffic.flows, rng)

    def fill(self, stage: Stage) -> None:
        """Puts the whole population on the road, spread over the network."""
        nowhere = np.empty((0, 2))
        for _ in range(self.traffic.vehicles):
            stage.add_vehicle(self._name("vehicle"), self._vehicle_trip(nowhere, on_the_way=True))
        for _ in range(self.traffic.bicycles):
            stage.add_vehicle(self._name("bicycle"), self._bicycle_trip(nowhere, on_the_way=True))
        for _ in range(self.traffic.pedestrians - self.traffic.jaywalker_count):
            self._send_pedestrian(stage, nowhere)

    def replace_arrived(self, stage: Stage, egos: FloatArray) -> None:
        """Sends one newcomer for everyone who arrived in the last tick, and whoever comes along a flow in this one.

        Args:
            stage: The simulation.
            egos: (E, 2), m, where newcomers should not appear.
        """
        self.replace(stage, *stage.arrived(), egos)
        self._ticks += 1
        for stream in self._streams:
            for _ in stream.due(self._ticks * TICK_S):
                trip = Trip(stream.type or self._vehicle_type(), stream.edges, on_the_way=False, lane=stream.lane)
                stage.add_vehicle(self._name("flow"), trip)

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
        kind = self._vehicle_type()
        return Trip(kind, edge_graph(self.network, "drivable").random_path(self.rng, egos, on_the_way), on_the_way)

    def _vehicle_type(self) -> str:
        return VEHICLE_TYPES[draw(self.rng, np.array(VEHICLE_SHARES))]

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
        a, b = int(hidden[draw(rng, weight[hidden])]), draw(rng, self.length)
        at = rng.uniform(0.05, 0.95, size=2) * self.length[[a, b]]
        return Walk(self.names[a], float(at[0]), self.names[b], float(at[1]))


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
