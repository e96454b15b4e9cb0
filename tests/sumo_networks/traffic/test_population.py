from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np
import pytest

from dohyo.sumo_networks.actors.requests import Request, SpawnPedestrian, SpawnVehicle, Walk
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.scenario import Traffic
from dohyo.sumo_networks.traffic.population import NOWHERE, VEHICLE_SHARES, VEHICLE_TYPES, Population
from dohyo.sumo_networks.units import SIGHT_M
from tests.worlds import _build, _road, lit_crossing

CITIES = ("ingolstadt", "adlershof")


class Paper:
    """Writes down what is asked for; only every other walk has a way on foot, or none."""

    def __init__(self, ways_on_foot: bool = True) -> None:
        self.trips: dict[str, SpawnVehicle] = {}
        self.walks: dict[str, Walk] = {}
        self._ways_on_foot = ways_on_foot
        self._asked = 0

    def population(
        self, network: RoadNetwork, vehicles: int = 0, bicycles: int = 0, pedestrians: int = 0
    ) -> Population:
        traffic = Traffic(vehicles=vehicles, bicycles=bicycles, pedestrians=pedestrians)
        return Population(network, traffic, np.random.default_rng(0), self.way_on_foot)

    def way_on_foot(self, walk: Walk) -> tuple[str, ...]:
        self._asked += 1
        return (walk.source, walk.target) if self._asked % 2 and self._ways_on_foot else ()

    def note(self, requests: Iterable[Request]) -> Paper:
        for request in requests:
            if isinstance(request, SpawnVehicle):
                assert request.name not in self.trips
                self.trips[request.name] = request
            else:
                assert isinstance(request, SpawnPedestrian)
                self.walks[request.name] = request.walk
        return self


def kinds(paper: Paper) -> Counter[str]:
    return Counter(name.split("-")[0] for name in (*paper.trips, *paper.walks))


@pytest.mark.parametrize("city", CITIES)
def test_the_road_is_filled_with_as_many_as_asked(city: str) -> None:
    paper = Paper()
    paper.note(paper.population(load_network(city), 50, 7, 20).fill())
    assert kinds(paper) == {"vehicle": 50, "bicycle": 7, "pedestrian": 20}
    assert all(trip.position == "random_free" for trip in paper.trips.values())


@pytest.mark.parametrize("city", CITIES)
def test_journeys_are_connected_and_open_to_their_kind(city: str) -> None:
    network, paper = load_network(city), Paper()
    paper.note(paper.population(network, 60, 30).fill())
    lanes, connections = network.lanes, network.connections
    nexts: set[tuple[str, str]] = set()
    for source, target in zip(connections.source.tolist(), connections.target.tolist(), strict=True):
        while lanes.internal[target]:
            target = int(connections.target[network.connections_from(target)[0]])
        nexts.add((network.edge_id(source), network.edge_id(target)))
    for trip in paper.trips.values():
        allowed = lanes.bicycle if trip.type == "bicycle" else lanes.drivable
        assert all(allowed[network.lanes_of_edge[edge]].any() for edge in trip.edges)
        assert set(zip(trip.edges[:-1], trip.edges[1:], strict=True)) <= nexts


def test_kinds_of_vehicles_come_in_their_shares() -> None:
    paper = Paper()
    paper.note(paper.population(lit_crossing().network, 3000).fill())
    count = Counter(trip.type for trip in paper.trips.values())
    for kind, share in zip(VEHICLE_TYPES, VEHICLE_SHARES, strict=True):
        assert count[kind] / 3000 == pytest.approx(share, abs=5 * (share * (1 - share) / 3000) ** 0.5)


def test_for_everyone_who_arrives_one_of_the_kind_sets_out() -> None:
    paper, arrived = Paper(), ("vehicle-3", "vehicle-9", "bicycle-2", "ego:ego", "ego:vehicle-1")
    people = paper.population(load_network("ingolstadt"), 5, 5, 5)
    paper.note(people.update(arrived, ("pedestrian-7",), NOWHERE))
    assert kinds(paper) == {"vehicle": 2, "bicycle": 1, "pedestrian": 1}
    assert all(trip.position == "base" for trip in paper.trips.values())


def test_newcomers_set_out_where_no_ego_sees_it() -> None:
    network, paper = load_network("adlershof"), Paper()
    people = paper.population(network, 1, 0, 1)
    arrived = [f"vehicle-{i}" for i in range(60)], [f"pedestrian-{i}" for i in range(60)]
    # An ego at the very place where, without egos, most vehicles enter.
    paper.note(people.update(*arrived, NOWHERE))
    entries = Counter(trip.edges[0] for trip in paper.trips.values())
    busiest = network.lanes_of_edge[entries.most_common(1)[0][0]][-1]
    ego = network.lane_shape(busiest)[:1] + 1.0
    again = Paper().note(people.update(*arrived, ego))
    for trip in again.trips.values():
        first = next(lane for lane in network.lanes_of_edge[trip.edges[0]] if network.lanes.drivable[lane])
        assert np.hypot(*(network.lane_shape(first)[0] - ego[0])) > SIGHT_M
    assert entries.most_common(1)[0][1] > 1


def test_the_same_seed_sends_the_same_people() -> None:
    first, second = Paper(), Paper()
    for paper in (first, second):
        paper.note(paper.population(load_network("ingolstadt"), 20, 5, 10).fill())
    assert first.trips == second.trips
    assert first.walks == second.walks


def test_a_road_that_meets_no_other_can_have_traffic() -> None:
    nodes = '<node id="w" x="0" y="0"/><node id="e" x="600" y="0"/>'
    network, paper = _build("road", nodes, _road("w", "e")), Paper()
    cars = paper.population(network, 3)
    paper.note(cars.fill())
    # Even where an ego sees the only entry.
    paper.note(cars.replace(["vehicle-1"], [], np.array([[10.0, 0.0]])))
    assert len(paper.trips) == 4
    assert {trip.edges for trip in paper.trips.values()} == {("w_e",)}


def test_traffic_of_a_kind_that_no_lane_is_open_to_is_refused() -> None:
    nodes = '<node id="w" x="0" y="0"/><node id="e" x="600" y="0"/>'
    network = _build("motorway", nodes, '<edge id="w_e" from="w" to="e" allow="passenger"/>')
    with pytest.raises(InvalidInputError, match="no two connected edges"):
        list(Paper().population(network, bicycles=1).fill())
    with pytest.raises(InvalidInputError, match="no sidewalk"):
        list(Paper().population(network, pedestrians=1).fill())


def test_where_nobody_can_walk_nobody_is_sent_for_ever() -> None:
    paper = Paper(ways_on_foot=False)
    paper.note(paper.population(load_network("ingolstadt"), 0, 0, 2).fill())
    assert paper.walks == {}
