"""SUMO's drivers yield to an ego that comes to a junction beside its route, such as in an oncoming lane."""

from __future__ import annotations

import math

import libsumo
import numpy as np
import pytest

from dohyo.sumo_networks.ego.pose import Pose
from dohyo.sumo_networks.routes.approaches import approach
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from dohyo.sumo_networks.simulation import Simulation
from dohyo.sumo_networks.simulation.sumo_traffic import vehicles_near
from dohyo.sumo_networks.world import World
from tests.conftest import Start
from tests.sumo_networks.simulation.drives import on
from tests.worlds import stop_sign_crossing

SPEED_MPS = 10.0
FROM_THE_NORTH = Mission(start=Place(lane="n_c_0", position_m=30.0), goal=Place(lane="c_s_0", position_m=-1.0))
OWN_LANE, OTHER_LANE, ONCOMING, FAR_ONCOMING = -4.8, -1.6, 1.6, 4.8


def southward(simulation: Simulation, x: float, y: float) -> World:
    """One tick in which the ego drives towards the junction from the north, which has priority."""
    pose = Pose(x, y, -0.5 * math.pi, 0.0, -SPEED_MPS)
    return simulation.tick(np.zeros((1, 2)), {0: pose})


def send(name: str, edges: list[str], lane: int, at_m: float, speed: float) -> None:
    libsumo.route.add(name, edges)
    libsumo.vehicle.add(name, name, "car", "now", str(lane), str(at_m), str(speed))


@pytest.mark.parametrize("x", [OWN_LANE, OTHER_LANE, ONCOMING, FAR_ONCOMING])
def test_who_comes_from_a_stop_sign_waits_for_an_ego_in_any_lane(x: float, start: Start) -> None:
    simulation, _ = start(on(stop_sign_crossing(), FROM_THE_NORTH))
    send("vehicle-1", ["w_c", "c_e"], 0, 100.0, 0.0)
    y, entered = 165.0, -math.inf
    while y > -30.0:
        y -= 0.1 * SPEED_MPS
        world = southward(simulation, x, y)
        assert [world.name_of(int(key)) for key in world.actors.key] in ([], ["vehicle-1"])
        assert not world.contacts
        if libsumo.vehicle.getRoadID("vehicle-1").startswith(":"):
            entered = max(entered, y)
    assert -30.0 < entered < 14.0, "it entered before the ego was inside"


def test_who_is_overtaken_before_a_junction_does_not_brake(start: Start) -> None:
    simulation, _ = start(on(stop_sign_crossing(), FROM_THE_NORTH))
    send("vehicle-1", ["n_c", "c_s"], 0, 60.0, SPEED_MPS)
    speeds, y = [], 135.0
    simulation.tick(np.zeros((1, 2)), {0: Pose(ONCOMING, y, -0.5 * math.pi, 0.0, -SPEED_MPS)})
    libsumo.vehicle.setMaxSpeed("vehicle-1", SPEED_MPS)
    while y > 40.0:
        y -= 0.1 * SPEED_MPS
        southward(simulation, ONCOMING, y)
        speeds.append(libsumo.vehicle.getSpeed("vehicle-1"))
    assert min(speeds[10:]) > SPEED_MPS - 2.0
    assert "ego:ego:approach" not in libsumo.vehicle.getIDList()


def test_an_ego_that_is_retired_leaves_nothing_on_its_route(start: Start) -> None:
    simulation, _ = start(on(stop_sign_crossing(), FROM_THE_NORTH))
    for y in (81.0, 80.0, 79.0):
        southward(simulation, ONCOMING, y)
    assert set(libsumo.vehicle.getIDList()) == {"ego:ego", "ego:ego:approach"}
    assert len(vehicles_near(ONCOMING, 79.0, 50.0)) == 1, "who wants to cross sees the ego alone"
    simulation.retire(0)
    simulation.tick(np.zeros((1, 2)))
    assert libsumo.vehicle.getIDList() == ()


def test_an_ego_that_is_back_on_its_route_has_one_proxy(start: Start) -> None:
    simulation, _ = start(on(stop_sign_crossing(), FROM_THE_NORTH))
    seen = []
    for x in (ONCOMING, ONCOMING, OTHER_LANE, OTHER_LANE):
        southward(simulation, x, 80.0)
        seen.append(len(libsumo.vehicle.getIDList()))
    assert seen[-1] == 1 < seen[1] == 2


def test_only_an_ego_that_drives_along_its_route_to_a_junction_approaches_it(start: Start) -> None:
    simulation, _ = start(on(stop_sign_crossing(), FROM_THE_NORTH))
    (route,) = simulation.plan.routes
    south = -0.5 * math.pi
    lane, x, y, direction, _ = approach(route, (ONCOMING, 60.0), south, inside=False) or pytest.fail("not found")
    assert simulation.plan.network.lanes.ids[lane] == "n_c_0"
    assert (x, y, direction) == pytest.approx((OWN_LANE, 60.0, south), abs=0.01)
    assert approach(route, (ONCOMING, 60.0), -south, inside=False) is None, "it drives back"
    assert approach(route, (ONCOMING, 140.0), south, inside=False) is None, "the junction is far"
    assert approach(route, (30.0, 60.0), south, inside=False) is None, "it drives elsewhere"
    assert approach(route, (ONCOMING, 5.0), south, inside=False) is None, "it is there"
    assert approach(route, (ONCOMING, 5.0), south, inside=True) is not None
    assert approach(route, (ONCOMING, -40.0), south, inside=True) is None, "it has passed it"


@pytest.mark.parametrize("aside_m", [-3.2, 3.2], ids=["in the lane beside", "in the oncoming lane"])
def test_who_follows_on_the_route_through_a_junction_does_not_brake(aside_m: float, start: Start) -> None:
    mission = Mission(
        start=Place(lane="lime_row_2_1", position_m=169.3),
        goal=Place(lane="south_street_1", position_m=404.6),
        via=("lime_row_3", "-avenue_3_far_west"),
    )
    empty = Traffic(vehicles=0, bicycles=0, pedestrians=0, warm_up_s=0.0)
    simulation, world = start(Scenario(network="district", missions=(mission,), traffic=empty))
    route, network, speed = world.routes[0], world.network, 13.0
    slowest = speed
    for tick in range(62):
        row = int(960 + 0.1 * speed * tick)
        heading = route.heading.item(row)
        along = np.array([math.cos(heading), math.sin(heading)])
        # First far from the road, so that the car can enter behind.
        x, y = route.position[row] + (aside_m if tick > 8 else 30.0) * np.array([-along[1], along[0]])
        simulation.tick(np.zeros((1, 2)), {0: Pose(x, y, heading, *(speed * along).tolist())})
        if tick == 0:
            edge = route.edges.index(str(network.edge_id(route.lane.item(952))))
            lane_start = network.lane_shape(route.lane.item(952))[0]
            send("vehicle-1", list(route.edges[edge : edge + 6]), 2, math.dist(lane_start, route.position[952]), speed)
            libsumo.vehicle.setMaxSpeed("vehicle-1", speed)
        elif tick > 12:
            slowest = min(slowest, libsumo.vehicle.getSpeed("vehicle-1"))
            assert "ego:ego:approach" not in libsumo.vehicle.getIDList(), tick
    assert slowest > 10.0, "it slows down for the bend alone"
