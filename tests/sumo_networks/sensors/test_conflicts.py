from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.rules.right_of_way import RightOfWay
from dohyo.sumo_networks.scenario import Mission, Place
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.sensors.conflicts import ROWS
from dohyo.sumo_networks.world import ActorKind, LightState, World
from tests.lights import SIDE_ROAD_X, asking, side_road
from tests.worlds import Scene, crossing_for_pedestrians, lit_crossing, stop_sign_crossing, straight_road

NORTH, SOUTH, WEST = math.pi / 2, -math.pi / 2, math.pi
FROM_SOUTH, FROM_EAST = {"x": 4.8, "y": -50.0, "heading": NORTH}, {"x": 40.0, "y": 1.6, "heading": WEST}
EGO_GIVES_WAY, OTHER_GIVES_WAY = 1.0, -1.0
# Half of both widths and a margin: within this of each other's centreline, two cars would touch.
REACH = 0.9 + 0.9 + 0.4


def conflicts(scene: Scene, *indicators: int) -> np.ndarray:
    """Rows in use; the actors show these indicators (1 left, -1 right)."""
    world = scene.world()
    if indicators:
        world = dataclasses.replace(world, actors=dataclasses.replace(world.actors, indicator=np.array(indicators)))
    (sensor,) = make_sensors(["conflicts"])
    rows = sensor.read(world, 0)
    assert rows.dtype == np.float32
    assert sensor.space.contains(rows)
    used = int((rows[:, 6] >= 0).sum())
    np.testing.assert_array_equal(rows[used:, :4], 1000.0)
    np.testing.assert_array_equal(rows[used:, 6], -1.0)
    return np.asarray(rows[:used])


def eastward(scene: Scene, x: float = -40.0, speed: float = 8.0) -> Scene:
    return scene.with_ego(x=x, speed=speed)


def northward(scene: Scene) -> Scene:
    mission = Mission(start=Place(lane="s_c_0"), goal=Place(lane="c_n_0", position_m=-1.0))
    return dataclasses.replace(scene, mission=mission).with_ego(x=4.8, y=-40.0, heading=NORTH, speed=8.0)


def test_a_crossing_car_is_found_with_its_distances() -> None:
    (row,) = conflicts(eastward(lit_crossing()).with_actor(speed=8.0, **FROM_SOUTH))
    front, rear, other_front, other_rear = -40 + 2.25, -40 - 2.25, -50 + 2.25, -50 - 2.25
    expected = [4.8 - REACH - front, 4.8 + REACH - rear, -4.8 - REACH - other_front, -4.8 + REACH - other_rear]
    assert row[:4] == pytest.approx(expected, abs=1.1)
    assert row[4] == pytest.approx(8.0)
    assert row[6:].tolist() == [ActorKind.CAR, 0.0]


def test_the_distances_shrink_as_both_drive_on() -> None:
    before = eastward(lit_crossing(), x=-40.0).with_actor(speed=8.0, **FROM_SOUTH)
    after = eastward(lit_crossing(), x=-30.0).with_actor(speed=8.0, x=4.8, y=-35.0, heading=NORTH)
    assert conflicts(before)[0, :4] - conflicts(after)[0, :4] == pytest.approx([10, 10, 15, 15], abs=1.1)


def test_distances_are_right_at_the_very_start_of_the_route_too() -> None:
    mission = Mission(start=Place(lane="w_c_0", position_m=160.0), goal=Place(lane="c_e_0", position_m=-1.0))
    begun = dataclasses.replace(lit_crossing(), mission=mission).with_ego(x=-40.0).with_actor(speed=8.0, **FROM_SOUTH)
    long_since = eastward(lit_crossing()).with_actor(speed=8.0, **FROM_SOUTH)
    assert begun.world().egos.progress[0] == pytest.approx(0.0, abs=0.01)
    np.testing.assert_allclose(conflicts(begun), conflicts(long_since), atol=1.1)


@pytest.mark.parametrize("spacing_m", [0.9, 1.1])
def test_the_points_of_a_route_need_not_be_a_metre_apart(spacing_m: float) -> None:
    """Smoothing shortens a route, so that its points are less than a metre apart."""
    world = eastward(lit_crossing()).with_actor(speed=8.0, **FROM_SOUTH).with_lights(LightState.RED).world()
    (route,) = world.routes
    arc = np.linspace(0.0, route.length, len(route.position))
    at = np.linspace(0.0, route.length, round(route.length / spacing_m) + 1)
    points = np.column_stack([np.interp(at, arc, column) for column in route.position.T])
    respaced = dataclasses.replace(world, routes=(dataclasses.replace(route, position=points),))
    np.testing.assert_allclose(read_rows(respaced), read_rows(world), atol=1.1)


# Right of way


def test_at_a_stop_sign_the_ego_gives_way() -> None:
    assert conflicts(eastward(stop_sign_crossing()).with_actor(speed=8.0, **FROM_SOUTH))[0, 5] == EGO_GIVES_WAY


def test_on_the_main_road_the_others_give_way() -> None:
    scene = northward(stop_sign_crossing()).with_actor(-50.0, 8.0, y=-4.8)
    assert conflicts(scene)[0, 5] == OTHER_GIVES_WAY


def test_who_has_a_red_light_gives_way() -> None:
    scene = eastward(lit_crossing()).with_actor(speed=8.0, **FROM_SOUTH)
    assert conflicts(scene.with_lights(LightState.RED))[0, 5] == OTHER_GIVES_WAY


@pytest.mark.parametrize(
    ("ego", "other", "gives_way"),
    [
        pytest.param(RightOfWay.MAJOR, RightOfWay.MAJOR, EGO_GIVES_WAY, id="the junction's rules"),
        pytest.param(RightOfWay.YIELD, RightOfWay.YIELD, EGO_GIVES_WAY, id="both blink: the junction's rules"),
        pytest.param(RightOfWay.MAJOR, RightOfWay.YIELD, OTHER_GIVES_WAY, id="the other's light blinks"),
        pytest.param(RightOfWay.MAJOR, RightOfWay.STOP, OTHER_GIVES_WAY, id="the other has an arrow"),
        pytest.param(RightOfWay.STOP, RightOfWay.MAJOR, EGO_GIVES_WAY, id="the ego has an arrow"),
    ],
)
def test_who_must_stop_or_yield_by_a_light_gives_way(ego: RightOfWay, other: RightOfWay, gives_way: float) -> None:
    scene = side_road(("G", 60)).with_ego(SIDE_ROAD_X, 8.0, y=-30.0, heading=NORTH).with_actor(-40.0, 8.0, y=-1.6)
    (row,) = read_rows(asking(scene.world(), s_c_0_r=ego, w_c_0_s=other))
    assert row[5] == gives_way


def test_an_ego_with_an_arrow_gives_way_even_to_who_would_have_to_without_lights() -> None:
    mission = Mission(start=Place(lane="w_c_0"), goal=Place(lane="c_e_0"))
    scene = dataclasses.replace(side_road(("G", 60)), mission=mission).with_ego(-40.0, 8.0)
    world = scene.with_actor(SIDE_ROAD_X, 8.0, y=-30.0, heading=NORTH).world()
    world = dataclasses.replace(world, actors=dataclasses.replace(world.actors, indicator=np.array([-1])))
    assert read_rows(world)[0, 5] == OTHER_GIVES_WAY
    assert read_rows(asking(world, w_c_0_s=RightOfWay.STOP))[0, 5] == EGO_GIVES_WAY


def test_who_is_in_the_junction_is_let_out() -> None:
    scene = eastward(stop_sign_crossing()).with_actor(4.8, 3.0, y=-9.0, heading=NORTH)
    assert conflicts(scene)[0, 5] == EGO_GIVES_WAY
    # The same where the other has no right to be there.
    scene = northward(stop_sign_crossing()).with_actor(-9.0, 3.0, y=-4.8)
    assert conflicts(scene)[0, 5] == EGO_GIVES_WAY


def test_an_oncoming_car_is_a_conflict_only_if_it_turns_across() -> None:
    scene = eastward(lit_crossing()).with_actor(speed=8.0, **FROM_EAST)
    assert len(conflicts(scene, 0)) == 0
    (row,) = conflicts(scene, 1)
    assert row[5] == OTHER_GIVES_WAY
    assert row[0] < 1000.0
    assert row[1] < 1000.0


def test_a_car_that_turns_into_the_egos_lane_joins_it() -> None:
    scene = eastward(lit_crossing()).with_actor(speed=8.0, **FROM_SOUTH)
    (row,) = conflicts(scene, -1)
    assert row[1] == 1000.0
    # It meets the ego's path somewhere between the junction's middle and its eastern end.
    assert 4.8 - REACH + 37.75 - 2 < row[0] < 10.4 + 37.75 + 2


# Who is no conflict


@pytest.mark.parametrize(
    "other",
    [
        pytest.param({"x": -60.0, "y": -4.8, "speed": 12.0}, id="a follower"),
        pytest.param({"x": -46.0, "y": -4.8, "speed": 12.0}, id="a follower at the bumper"),
        pytest.param({"x": -20.0, "y": -4.8, "speed": 3.0}, id="a leader"),
        pytest.param({"x": -40.0, "y": -1.6, "speed": 8.0}, id="a car beside it"),
        pytest.param({"x": -50.0, "y": -1.6, "speed": 12.0}, id="a car about to overtake"),
        pytest.param({"x": -20.0, "y": 4.8, "speed": 8.0, "heading": WEST}, id="a car that has passed"),
        pytest.param({"x": 4.8, "y": 40.0, "speed": 8.0, "heading": NORTH}, id="a car that has crossed"),
        pytest.param({"x": 30.0, "y": 40.0, "speed": 8.0}, id="a car off the road"),
        pytest.param({"x": 4.8, "y": -120.0, "speed": 8.0, "heading": NORTH}, id="a car far away"),
    ],
)
def test_who_does_not_cross_the_path_is_no_conflict(other: dict[str, float]) -> None:
    assert len(conflicts(eastward(lit_crossing()).with_actor(**other))) == 0


def test_on_a_straight_road_there_are_no_conflicts() -> None:
    scene = straight_road().with_ego(x=500.0, speed=10.0)
    for x in range(400, 600, 20):
        scene = scene.with_actor(float(x) + 7.0, 9.0, left=3.2).with_actor(float(x), 9.0, left=6.4, heading=WEST)
    assert len(conflicts(scene)) == 0


# People


def before_the_crossing() -> Scene:
    """The western zebra crosses the ego's lane at x = -8.4."""
    return crossing_for_pedestrians().with_ego(x=-40.0, speed=8.0)


def test_a_pedestrian_on_a_crossing_is_found_with_its_distances() -> None:
    (row,) = conflicts(before_the_crossing().with_pedestrian(-8.4, 1.4, y=3.0, heading=SOUTH))
    reach = 0.9 + 0.25 + 0.4
    front, rear = -40 + 2.25, -40 - 2.25
    assert row[:2] == pytest.approx([-8.4 - reach - front, -8.4 + reach - rear], abs=1.1)
    assert row[2] == pytest.approx(3.0 - (-4.8 + reach) - 0.15, abs=0.6)
    assert row[4:].tolist() == pytest.approx([1.4, EGO_GIVES_WAY, ActorKind.PEDESTRIAN, 0.0])


@pytest.mark.parametrize(
    ("y", "speed", "heading", "count"),
    [
        pytest.param(3.0, 1.4, SOUTH, 1, id="coming"),
        pytest.param(-4.8, 1.4, SOUTH, 1, id="in front of the ego"),
        pytest.param(-4.8, 1.4, NORTH, 1, id="in front of the ego, the other way"),
        pytest.param(3.0, 1.4, NORTH, 0, id="going away"),
        pytest.param(-8.0, 1.4, SOUTH, 0, id="gone"),
        pytest.param(3.0, 0.0, SOUTH, 0, id="standing"),
        pytest.param(3.0, 0.3, SOUTH, 0, id="so slow that it takes more than six seconds"),
        pytest.param(-9.0, 1.4, 0.0, 0, id="along the sidewalk"),
    ],
)
def test_people_keep_walking_the_way_they_walk(y: float, speed: float, heading: float, count: int) -> None:
    rows = conflicts(before_the_crossing().with_pedestrian(-8.4, speed, y=y, heading=heading))
    assert len(rows) == count


# Other egos


def beside_another_ego(scene: Scene, x: float, y: float, heading: float, goal: str = "c_n_0") -> World:
    """The scene's world with a second ego, at 8 m/s, whose route leads from the south to a lane."""
    world = scene.with_ego(x, 8.0, y=y, heading=heading).world()
    route = plan_route(scene.network, Mission(start=Place(lane="s_c_0"), goal=Place(lane=goal, position_m=-1.0)))
    progress, lateral, direction = route.project(x, y, 0.0, ahead=route.length)
    egos = dataclasses.replace(
        world.egos,
        progress=np.array([world.egos.progress[0], progress]),
        lateral=np.array([world.egos.lateral[0], lateral]),
        route_heading_error=np.array([world.egos.route_heading_error[0], heading - direction]),
    )
    return dataclasses.replace(world, egos=egos, routes=(world.routes[0], route))


def read_rows(world: World, ego: int = 0) -> np.ndarray:
    rows = make_sensors(["conflicts"])[0].read(world, ego)
    return np.asarray(rows[rows[:, 6] >= 0])


@pytest.mark.parametrize(("goal", "indicator"), [("c_n_0", 0), ("c_e_0", -1)])
def test_another_ego_counts_as_a_car_that_indicates_its_routes_turn(goal: str, indicator: int) -> None:
    (expected,) = conflicts(eastward(stop_sign_crossing()).with_actor(speed=8.0, **FROM_SOUTH), indicator)
    (row,) = read_rows(beside_another_ego(eastward(stop_sign_crossing()), **FROM_SOUTH, goal=goal))
    np.testing.assert_array_equal(row[:6], expected[:6])
    assert row[6:].tolist() == [ActorKind.EGO, -2.0]


def test_of_two_egos_only_one_gives_way() -> None:
    world = beside_another_ego(eastward(stop_sign_crossing()), **FROM_SOUTH)
    assert [read_rows(world, ego)[0, 5] for ego in (0, 1)] == [EGO_GIVES_WAY, OTHER_GIVES_WAY]


def test_an_ego_whose_drive_is_over_is_no_conflict() -> None:
    world = beside_another_ego(eastward(lit_crossing()), **FROM_SOUTH)
    gone = dataclasses.replace(world.egos, active=np.array([True, False]))
    assert len(read_rows(world)) == 1
    assert len(read_rows(dataclasses.replace(world, egos=gone))) == 0


@pytest.mark.parametrize(
    ("x", "heading"),
    [pytest.param(9.0, NORTH, id="beside the road"), pytest.param(-4.8, NORTH, id="in the wrong lane")],
)
def test_of_an_ego_beside_its_lanes_or_against_them_nothing_is_expected(x: float, heading: float) -> None:
    assert len(read_rows(beside_another_ego(eastward(lit_crossing()), x, -50.0, heading))) == 0


def test_egos_that_follow_each_other_are_no_conflict() -> None:
    world = eastward(lit_crossing()).with_ego(-60.0, 12.0).world()
    assert len(read_rows(world, 0)) == 0
    assert len(read_rows(world, 1)) == 0


# Many


def test_the_nearest_conflict_comes_first_and_the_farthest_are_left_out() -> None:
    scene = before_the_crossing()
    for i in range(ROWS + 6):
        scene = scene.with_pedestrian(-30.0 + 1.5 * i, 1.4, y=0.0, heading=SOUTH)
    rows = conflicts(scene)
    assert len(rows) == ROWS
    assert (np.diff(rows[:, 0]) >= 0).all()
    np.testing.assert_array_equal(rows[:, 7], np.arange(ROWS))


def test_a_sensor_may_be_used_in_one_network_after_another() -> None:
    (sensor,) = make_sensors(["conflicts"])
    first = eastward(lit_crossing()).with_actor(speed=8.0, **FROM_SOUTH).world()
    second = straight_road().with_ego(x=500.0).with_actor(520.0).world()
    before = sensor.read(first, 0)
    assert (sensor.read(second, 0)[:, 6] == -1.0).all()
    np.testing.assert_array_equal(sensor.read(first, 0), before)
