"""Roads that are open to cars and closed to other vehicles: who drives where, and that no episode is lost."""

from __future__ import annotations

from functools import cache

import libsumo
import numpy as np
import pytest

from dohyo.sumo_networks.actors.requests import SpawnVehicle
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.edge_graph import edge_graph
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic, TrafficFlow
from dohyo.sumo_networks.traffic.population import NOWHERE, Population
from tests.conftest import Start
from tests.sumo_networks.simulation.drives import BRAKE, driven
from tests.worlds import _build, _road

CLOSED, DETOUR, IN, OUT = "a_n", "a_s", "w_a", "b_e"
MISSION = Mission(start=Place(lane="w_a_0", position_m=100.0), goal=Place(lane="b_e_0", position_m=-5.0))
HEAVY = ("van", "truck", "bus")


@cache
def diamond(*closed: str) -> RoadNetwork:
    """A road that forks and joins again; the shorter way, or other edges, are closed to all but cars."""
    places = {"w": (0, 0), "a": (300, 0), "n": (500, 20), "s": (500, -150), "b": (700, 0), "e": (1000, 0)}
    nodes = "".join(f'<node id="{name}" x="{x}" y="{y}"/>' for name, (x, y) in places.items())
    edges = ""
    for start, end in ("wa", "an", "nb", "as", "sb", "be"):
        ban = ' disallow="delivery truck bus"' if f"{start}_{end}" in closed else ""
        edges += _road(start, end).replace("/>", f"{ban}/>")
    return _build("diamond", nodes, edges)


def scenario(*closed: str, **traffic: object) -> Scenario:
    defaults: dict[str, object] = {"vehicles": 40, "warm_up_s": 20.0}
    return Scenario(
        network=str(diamond(*closed).path),
        missions=(MISSION,),
        traffic=Traffic.model_validate(defaults | traffic),
        seed=1,
    )


def flow(**changed: object) -> TrafficFlow:
    return TrafficFlow.model_validate({"source": IN, "target": OUT, "gap_s": (4, 4), **changed})


def trips(network: RoadNetwork, egos: np.ndarray = NOWHERE) -> list[SpawnVehicle]:
    """Who comes where trucks may not leave the network, at first and later."""
    closed = frozenset(network.lanes_of_edge[OUT])
    population = Population(
        network,
        Traffic(vehicles=300),
        np.random.default_rng(0),
        lambda _: (),
        lambda kind: closed if kind == "truck" else frozenset(),
    )
    requests = list(population.fill())
    requests += population.replace([request.name for request in requests], (), egos)  # type: ignore[union-attr]
    return [request for request in requests if isinstance(request, SpawnVehicle)]


def test_who_may_not_drive_on_a_road_goes_round_it(start: Start) -> None:
    simulation, _ = start(scenario(CLOSED))
    used: dict[str, set[str]] = {}
    for _ in range(60):
        driven(simulation, BRAKE, 1.0)
        for name in libsumo.vehicle.getIDList():
            if name.startswith("vehicle"):
                used.setdefault(libsumo.vehicle.getTypeID(name).split("@")[0], set()).update(
                    libsumo.vehicle.getRoute(name)
                )
    assert CLOSED in used["car"]
    assert any(kind in used for kind in HEAVY), "nobody for whom the road is closed ever came"
    for kind in set(used) & set(HEAVY):
        assert CLOSED not in used[kind]


def test_a_closed_border_keeps_trucks_away_and_not_their_number() -> None:
    network = diamond()
    for egos in (NOWHERE, np.array([[0.0, 0.0]])):
        found = trips(network, egos)
        assert len(found) == 600
        assert {trip.type for trip in found} == {"car", "van", "bus"}
        assert found == trips(network, egos), "the seed decides"


@pytest.mark.parametrize("edge", [CLOSED, "n_b"])
def test_nobody_sets_out_or_ends_where_the_road_goes_on_for_others(edge: str) -> None:
    network = diamond()
    graph = edge_graph(network, "drivable", frozenset(network.lanes_of_edge[edge]))
    paths = {graph.random_path(np.random.default_rng(seed), NOWHERE, on_the_way=False) for seed in range(50)}
    assert paths == {(IN, DETOUR, "s_b", OUT)}


def test_a_mixed_flow_sends_each_by_a_way_that_is_open_to_it(start: Start) -> None:
    simulation, _ = start(scenario(CLOSED, vehicles=0, flows=(flow(),)))
    requests = [
        request
        for _ in range(6000)
        for request in simulation._population.update((), (), NOWHERE)
        if isinstance(request, SpawnVehicle)
    ]
    assert {request.type for request in requests} == {"car", *HEAVY}
    assert all((DETOUR in request.edges) == (request.type in HEAVY) for request in requests)


def test_of_a_mixed_flow_to_a_closed_road_only_cars_come(start: Start) -> None:
    simulation, world = start(scenario(OUT, vehicles=0, warm_up_s=60.0, flows=(flow(),)))
    while world.time < 60.0:
        world = simulation.tick(BRAKE[None])
    kinds = {libsumo.vehicle.getTypeID(name).split("@")[0] for name in libsumo.vehicle.getIDList() if "flow" in name}
    assert kinds == {"car"}


def test_a_flow_of_trucks_to_a_road_closed_to_them_is_refused(start: Start) -> None:
    with pytest.raises(InvalidInputError, match=r"flows\[0\]: no path that is open to a truck leads from edge 'w_a'"):
        start(scenario(OUT, flows=(flow(type="truck"),)))
    simulation, _ = start(scenario(CLOSED, flows=(flow(type="truck"),)))
    assert driven(simulation, BRAKE, 10.0)[-1].tick == 100


def test_a_lane_on_which_a_flow_may_not_enter_is_refused() -> None:
    network = diamond()
    closed = frozenset({network.lane_index["w_a_1"]})
    traffic = Traffic(flows=(flow(source="w_a_1", type="bus"),))
    population = Population(network, traffic, np.random.default_rng(0), lambda _: (), lambda _: closed)
    with pytest.raises(InvalidInputError, match="no path that is open to a bus"):
        list(population.fill())
