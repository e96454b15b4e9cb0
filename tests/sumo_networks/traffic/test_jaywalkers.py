"""Jaywalkers: they cross away from crossings, walk as people walk, look first, and the traffic sees them."""

from __future__ import annotations

import math

import libsumo
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.sumo_networks.actors.requests import HideActor, ShowActor
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from dohyo.sumo_networks.traffic.jaywalkers import END_M, ROOM_M, Jaywalkers, is_free, streets
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import ActorKind, World
from tests.conftest import Start
from tests.worlds import straight_road

TOWN = "town-test"


class Pavement:
    """A road without SUMO: the same vehicles everywhere, and the proxies that the traffic would see."""

    def __init__(self, *vehicles: tuple[float, ...]) -> None:
        self.vehicles = np.array(vehicles, dtype=np.float64).reshape(-1, 6)
        self.shown: set[str] = set()

    def tick(self, people: Jaywalkers) -> None:
        for request in people.update(TICK_S, self.vehicles_near, ("e",)):
            if isinstance(request, ShowActor):
                self.shown.add(request.name)
            elif isinstance(request, HideActor):
                self.shown.discard(request.name)

    def vehicles_near(self, x: float, y: float, radius_m: float) -> FloatArray:
        return self.vehicles


def followed(people: Jaywalkers, stage: Pavement, seconds: float) -> FloatArray:
    """(T, N, 2) where they were at every tick, m."""
    rows = []
    for _ in range(round(seconds / TICK_S)):
        stage.tick(people)
        rows.append([(one.x, one.y) for one in people.actors])
    return np.array(rows)


def offsets(trace: FloatArray) -> FloatArray:
    """(T, N) distance to the middle of the nearest drivable lane, over half that lane's width: below 1 on it."""
    network = load_network(TOWN)
    anywhere = np.zeros(len(network.lanes.ids), dtype=np.bool_)
    out = np.full(trace.shape[:2], np.inf)
    for index in np.ndindex(*out.shape):
        x, y = trace[index].tolist()
        lane, offset, _ = network.nearest_lane(x, y, 0.0, anywhere)
        if lane >= 0:
            out[index] = abs(offset) / (0.5 * network.lanes.width[lane])
    return out


# How they walk


def test_they_cross_at_walking_speed_without_a_jump_and_far_from_the_streets_ends() -> None:
    network, stage = load_network(TOWN), Pavement()
    people = Jaywalkers(network, 8, np.random.default_rng(0))
    trace = followed(people, stage, 240.0)
    speed = np.hypot(*np.moveaxis(np.diff(trace, axis=0), 2, 0)) / TICK_S
    assert speed.max() <= 2.0 + 1e-6
    on_road = offsets(trace[::5]) < 0.9
    assert on_road.any(axis=0).mean() > 0.5, "in four minutes most of them have crossed"
    assert on_road.mean() < 0.5, "and most of the time they are on a sidewalk"
    crossings = [network.lane_shape(int(lane)).mean(axis=0) for lane in np.flatnonzero(network.lanes.crossing)]
    places = trace[::5][on_road]
    assert min(np.hypot(*(places - middle).T).min() for middle in crossings) > 0.6 * END_M


def test_the_same_seed_walks_the_same_way() -> None:
    network = load_network(TOWN)
    first, second, other = (
        followed(Jaywalkers(network, 3, np.random.default_rng(seed)), Pavement(), 60.0) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, other)


def test_they_are_shown_to_the_traffic_while_they_cross_and_only_then() -> None:
    people, stage = Jaywalkers(load_network(TOWN), 1, np.random.default_rng(3)), Pavement()
    shown, on_road = [], []
    for _ in range(3000):
        trace = followed(people, stage, TICK_S)
        shown.append(bool(stage.shown))
        on_road.append(bool(offsets(trace)[0, 0] < 0.9))
    assert sum(on_road) > 20
    assert all(seen for seen, on in zip(shown, on_road, strict=True) if on)
    assert not all(shown)


def test_nobody_steps_before_a_stream_that_never_ends() -> None:
    people = Jaywalkers(load_network(TOWN), 4, np.random.default_rng(0))
    x, y = np.mean([(one.x, one.y) for one in people.actors], axis=0)
    rows = [
        (px, py, heading, 4.6, 1.8, 14.0)
        for px in np.arange(x - 300, x + 300, 25.0)
        for py in np.arange(y - 300, y + 300, 12.0)
        for heading in (0.0, math.pi)
    ]
    stage = Pavement(*rows)
    assert offsets(followed(people, stage, 60.0)[::10]).min() > 1.0
    assert stage.shown == set()


# When the road is free: a line of 8 m across a road that leads east


@pytest.mark.parametrize(
    ("vehicle", "free"),
    [
        ((-60.0, -2.0, 0.0, 4.6, 1.8, 14.0), False),
        ((-60.0, -2.0, 0.0, 4.6, 1.8, 5.0), True),
        ((-60.0, -2.0, math.pi, 4.6, 1.8, 14.0), True),
        ((60.0, 2.0, math.pi, 4.6, 1.8, 14.0), False),
        ((0.0, -2.0, 0.0, 4.6, 1.8, 0.0), False),
        ((-2.3 - ROOM_M + 0.1, -2.0, 0.0, 4.6, 1.8, 0.0), False),
        ((-2.3 - ROOM_M - 0.1, -2.0, 0.0, 4.6, 1.8, 0.0), True),
        ((0.0, 30.0, -math.pi / 2, 4.6, 1.8, 8.0), False),
    ],
)
def test_who_comes_or_stands_in_the_way_is_waited_for(vehicle: tuple[float, ...], free: bool) -> None:
    assert is_free(np.array([vehicle]), (0.0, 0.0, math.pi / 2), 4.0, 6.0) is free


@given(st.floats(1.0, 20.0), st.floats(5.0, 80.0), st.floats(0.5, 10.0))
def test_less_time_never_makes_a_free_road_less_free(speed: float, away: float, seconds: float) -> None:
    vehicle = np.array([(-away, -2.0, 0.0, 4.6, 1.8, speed)])
    if is_free(vehicle, (0.0, 0.0, math.pi / 2), 4.0, seconds):
        assert is_free(vehicle, (0.0, 0.0, math.pi / 2), 4.0, 0.5 * seconds)


# In SUMO


def town(jaywalkers: float, pedestrians: int = 20) -> Scenario:
    traffic = Traffic(vehicles=30, pedestrians=pedestrians, jaywalkers=jaywalkers, warm_up_s=10.0)
    network = load_network(TOWN)
    lanes = [
        str(lane) for lane in network.lanes.ids[network.lanes.drivable & ~network.lanes.internal] if ":" not in lane
    ]
    mission = Mission(start=Place(lane=lanes[0], position_m=5.0), goal=Place(lane=lanes[0], position_m=-5.0))
    return Scenario(network=TOWN, missions=(mission,), traffic=traffic)


def names(world: World) -> set[str]:
    return {world.name_of(int(key)) for key in world.actors.key}


def test_a_share_of_the_pedestrians_are_jaywalkers_and_the_traffic_runs_no_one_over(start: Start) -> None:
    simulation, world = start(town(0.5))
    touched, moved, met = 0, {}, set[str]()
    for _ in range(900):
        world = simulation.tick(np.zeros((1, 2)))
        met |= {name for name in names(world) if name.startswith("jaywalker")}
        everyone = simulation.all_actors()[1]
        walkers = everyone.kind == ActorKind.PEDESTRIAN
        boxes, drivers = everyone.boxes()[walkers], everyone.boxes()[everyone.kind <= int(ActorKind.BUS)]
        near = np.hypot(*(boxes[:, None, :2] - drivers[None, :, :2]).T) < 0.9
        touched += int(near.sum())
        moved[world.tick] = len(boxes)
    assert moved[1] == 20, "ten of SUMO's and ten of ours"
    assert touched == 0
    assert len(met) >= 1
    rows = [row for row, key in enumerate(world.actors.key) if world.name_of(int(key)).startswith("jaywalker")]
    assert all(world.actors.kind[row] == ActorKind.PEDESTRIAN for row in rows)
    assert libsumo.simulation.getCollidingVehiclesNumber() == 0


def test_there_are_none_unless_asked_for(start: Start) -> None:
    def positions(scenario: Scenario) -> list[bytes]:
        simulation, _ = start(scenario)
        return [simulation.tick(np.zeros((1, 2))).actors.position.tobytes() for _ in range(50)]

    plain = town(0.0)
    assert "jaywalkers" not in plain.model_dump_json()
    assert positions(plain) == positions(plain)
    assert positions(town(0.5)) != positions(plain)


def test_a_network_without_streets_is_refused(start: Start) -> None:
    scene = straight_road()
    traffic = Traffic(pedestrians=4, jaywalkers=1.0)
    scenario = Scenario(network=str(scene.network.path), missions=(scene.mission,), traffic=traffic)
    with pytest.raises(InvalidInputError, match=r"traffic.jaywalkers: network '.*' has no street of 60 m"):
        start(scenario)
    assert not libsumo.isLoaded()


def test_streets_have_their_other_side_where_it_is() -> None:
    network = load_network(TOWN)
    sidewalks = network.lanes.pedestrian & ~network.lanes.drivable & ~network.lanes.crossing
    middles = np.concatenate([network.lane_shape(int(lane)) for lane in np.flatnonzero(sidewalks)])
    assert len(streets(network)) > 10
    for street in streets(network):
        x, y, _ = street.sidewalk.at(street.sidewalk.length - END_M, street.across_m)
        ends = np.hypot(*(middles - (x, y)).T).min()
        assert ends < END_M + 5.0
        assert 6.0 < street.across_m < 20.0
