from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.scenario import Traffic
from dohyo.sumo_networks.traffic.population import VEHICLE_SHARES, VEHICLE_TYPES, Population, Trip, Walk
from dohyo.sumo_networks.units import SIGHT_M
from tests.worlds import _build, _road, lit_crossing

CITIES = ("ingolstadt", "adlershof")
NOWHERE = np.empty((0, 2))


class Paper:
    """A stage on paper: writes down who is sent where; of pedestrians it takes only every other one."""

    def __init__(self, *arrived: str, ways_on_foot: bool = True) -> None:
        self.trips: dict[str, Trip] = {}
        self.walks: dict[str, Walk] = {}
        self._arrived = arrived
        self._ways_on_foot = ways_on_foot
        self._asked = 0

    def add_vehicle(self, name: str, trip: Trip) -> None:
        assert name not in self.trips
        self.trips[name] = trip

    def add_pedestrian(self, name: str, walk: Walk) -> bool:
        self._asked += 1
        if self._asked % 2 and self._ways_on_foot:
            self.walks[name] = walk
            return True
        return False

    def arrived(self) -> tuple[list[str], list[str]]:
        walkers = [name for name in self._arrived if name.startswith("pedestrian")]
        return [name for name in self._arrived if name not in walkers], walkers


def population(network: RoadNetwork, vehicles: int = 0, bicycles: int = 0, pedestrians: int = 0) -> Population:
    traffic = Traffic(vehicles=vehicles, bicycles=bicycles, pedestrians=pedestrians)
    return Population(network, traffic, np.random.default_rng(0))


def kinds(paper: Paper) -> Counter[str]:
    return Counter(name.split("-")[0] for name in (*paper.trips, *paper.walks))


@pytest.mark.parametrize("city", CITIES)
def test_the_road_is_filled_with_as_many_as_asked(city: str) -> None:
    paper = Paper()
    population(load_network(city), 50, 7, 20).fill(paper)
    assert kinds(paper) == {"vehicle": 50, "bicycle": 7, "pedestrian": 20}
    assert all(trip.on_the_way for trip in paper.trips.values())


@pytest.mark.parametrize("city", CITIES)
def test_journeys_are_connected_and_open_to_their_kind(city: str) -> None:
    network, paper = load_network(city), Paper()
    population(network, 60, 30).fill(paper)
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
    population(lit_crossing().network, 3000).fill(paper)
    count = Counter(trip.type for trip in paper.trips.values())
    for kind, share in zip(VEHICLE_TYPES, VEHICLE_SHARES, strict=True):
        assert count[kind] / 3000 == pytest.approx(share, abs=0.02)


def test_for_everyone_who_arrives_one_of_the_kind_sets_out() -> None:
    paper = Paper("vehicle-3", "vehicle-9", "bicycle-2", "pedestrian-7", "ego:ego", "ego:vehicle-1")
    population(load_network("ingolstadt"), 5, 5, 5).replace_arrived(paper, NOWHERE)
    assert kinds(paper) == {"vehicle": 2, "bicycle": 1, "pedestrian": 1}
    assert not any(trip.on_the_way for trip in paper.trips.values())


def test_newcomers_set_out_where_no_ego_sees_it() -> None:
    network, paper = (
        load_network("adlershof"),
        Paper(*(f"{kind}-{i}" for i in range(60) for kind in ("vehicle", "pedestrian"))),
    )
    people = population(network, 1, 0, 1)
    # An ego at the very place where, without egos, most vehicles enter.
    people.replace_arrived(paper, NOWHERE)
    entries = Counter(trip.edges[0] for trip in paper.trips.values())
    busiest = network.lanes_of_edge[entries.most_common(1)[0][0]][-1]
    ego = network.lane_shape(busiest)[:1] + 1.0
    again = Paper(*paper._arrived)
    people.replace_arrived(again, ego)
    for trip in again.trips.values():
        first = next(lane for lane in network.lanes_of_edge[trip.edges[0]] if network.lanes.drivable[lane])
        assert np.hypot(*(network.lane_shape(first)[0] - ego[0])) > SIGHT_M
    assert entries.most_common(1)[0][1] > 1


def test_the_same_seed_sends_the_same_people() -> None:
    first, second = Paper(), Paper()
    for paper in (first, second):
        population(load_network("ingolstadt"), 20, 5, 10).fill(paper)
    assert first.trips == second.trips
    assert first.walks == second.walks


def test_a_road_that_meets_no_other_can_have_traffic() -> None:
    nodes = '<node id="w" x="0" y="0"/><node id="e" x="600" y="0"/>'
    network, paper = _build("road", nodes, _road("w", "e")), Paper()
    cars = population(network, 3)
    cars.fill(paper)
    # Even where an ego sees the only entry.
    cars.replace(paper, ["vehicle-1"], [], np.array([[10.0, 0.0]]))
    assert len(paper.trips) == 4
    assert {trip.edges for trip in paper.trips.values()} == {("w_e",)}


def test_traffic_of_a_kind_that_no_lane_is_open_to_is_refused() -> None:
    nodes = '<node id="w" x="0" y="0"/><node id="e" x="600" y="0"/>'
    network = _build("motorway", nodes, '<edge id="w_e" from="w" to="e" allow="passenger"/>')
    with pytest.raises(InvalidInputError, match="no two connected edges"):
        population(network, bicycles=1).fill(Paper())
    with pytest.raises(InvalidInputError, match="no sidewalk"):
        population(network, pedestrians=1).fill(Paper())


def test_where_nobody_can_walk_nobody_is_sent_for_ever() -> None:
    paper = Paper(ways_on_foot=False)
    population(load_network("ingolstadt"), 0, 0, 2).fill(paper)
    assert paper.walks == {}
