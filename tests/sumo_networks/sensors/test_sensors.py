from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.routes.command import Command
from dohyo.sumo_networks.rules.right_of_way import RightOfWay
from dohyo.sumo_networks.scenario import Mission, Place
from dohyo.sumo_networks.sensors import PRESETS, SENSORS, Track, make_sensors
from dohyo.sumo_networks.sensors.objects import ROWS
from dohyo.sumo_networks.world import ActorKind, LightState, World
from tests.worlds import Scene, crossing_for_pedestrians, lit_crossing, stop_sign_crossing, straight_road


def read(sensor: str, world: World, ego: int = 0) -> np.ndarray:
    (made,) = make_sensors([sensor])
    array = made.read(world, ego)
    assert array.dtype == made.space.dtype
    assert made.space.contains(array)
    return array


def busy_crossing() -> Scene:
    """An ego a little off its path before a crossing with cars and people all around."""
    scene = crossing_for_pedestrians().with_ego(x=-45.0, left=0.6, heading=0.15, speed=7.0)
    scene = scene.with_actor(4.8, 8.0, y=-50.0, heading=math.pi / 2).with_actor(-20.0, 3.0).with_actor(-72.0, 9.0)
    scene = scene.with_actor(40.0, 6.0, y=4.8, heading=math.pi).with_pedestrian(-8.4, 1.4, y=3.0, heading=-math.pi / 2)
    return scene.with_lights(LightState.RED, s=LightState.GREEN)


WHERE_ONE_IS = {"gnss", "gnss_rtk", "route_map"}
PICTURES = {preset.name for preset in PRESETS}  # tested with a tolerance of theirs


@pytest.mark.parametrize("sensor", sorted(set(SENSORS) - WHERE_ONE_IS - PICTURES))
@pytest.mark.parametrize(("dx", "dy", "angle"), [(500.0, -300.0, 0.0), (0.0, 0.0, 1.0), (-80.0, 2000.0, -2.5)])
def test_where_the_world_lies_on_the_map_is_nothing_to_an_ego(sensor: str, dx: float, dy: float, angle: float) -> None:
    here, there = busy_crossing(), busy_crossing().transformed(dx, dy, angle)
    np.testing.assert_allclose(read(sensor, there.world()), read(sensor, here.world()), atol=2e-3)


# Objects


def test_objects_come_nearest_first_in_the_egos_frame() -> None:
    scene = straight_road().with_ego(x=100.0, speed=5.0)
    scene = scene.with_actor(140.0, 9.0).with_actor(90.0, 2.0, left=3.2, kind=ActorKind.BUS, length=12.0, width=2.5)
    rows = read("objects", scene.world())
    assert rows[0] == pytest.approx([ActorKind.BUS, -10.0, 3.2, 0.0, 2.0, 12.0, 2.5, 1.0], abs=1e-5)
    assert rows[1] == pytest.approx([ActorKind.CAR, 40.0, 0.0, 0.0, 9.0, 4.5, 1.8, 0.0], abs=1e-5)
    np.testing.assert_array_equal(rows[2:, 0], -1.0)
    np.testing.assert_array_equal(rows[2:, 1:], 0.0)


def test_a_turned_ego_sees_the_others_turned_the_other_way() -> None:
    scene = straight_road().with_ego(x=100.0, heading=math.pi / 2).with_actor(100.0, 4.0, left=15.0, heading=math.pi)
    (row,) = read("objects", scene.world())[:1]
    assert row == pytest.approx([ActorKind.CAR, 15.0, 0.0, math.pi / 2, 4.0, 4.5, 1.8, 0.0], abs=1e-5)
    scene = straight_road().with_ego(x=100.0, heading=-3.0).with_actor(100.0, heading=3.0)
    assert read("objects", scene.world())[0, 3] == pytest.approx(6.0 - 2 * math.pi, abs=1e-5)


def test_of_too_many_the_nearest_are_seen() -> None:
    scene = straight_road().with_ego(x=500.0)
    for i in range(ROWS + 12):
        scene = scene.with_actor(500.0 - 6.0 * (i + 1) * (-1) ** i)
    rows = read("objects", scene.world())
    np.testing.assert_array_equal(rows[:, 7], np.arange(ROWS))
    np.testing.assert_allclose(np.abs(rows[:, 1]), 6.0 * np.arange(1, ROWS + 1), rtol=1e-5)


def test_other_egos_are_objects_while_they_drive() -> None:
    world = straight_road().with_ego(x=100.0).with_ego(x=130.0, speed=6.0).with_actor(110.0).world()
    rows = read("objects", world)
    assert rows[1] == pytest.approx([ActorKind.EGO, 30.0, 0.0, 0.0, 6.0, 4.5, 1.8, -2.0], abs=1e-5)
    assert read("objects", world, ego=1)[1, [0, 1, 7]] == pytest.approx([ActorKind.EGO, -30.0, -1.0])
    retired = dataclasses.replace(world, egos=dataclasses.replace(world.egos, active=np.array([True, False])))
    assert read("objects", retired)[:, 0].tolist() == [ActorKind.CAR] + [-1.0] * (ROWS - 1)


def test_what_another_ego_sees_far_away_is_no_object() -> None:
    world = straight_road().with_ego(x=100.0).with_ego(x=250.0).with_actor(190.0).with_actor(210.0).world()
    assert read("objects", world)[:2, 0].tolist() == [ActorKind.CAR, -1.0]
    assert sorted(read("objects", world, ego=1)[:, 1].tolist())[:2] == pytest.approx([-60.0, -40.0])


def test_on_an_empty_road_there_are_no_objects() -> None:
    assert (read("objects", straight_road().with_ego(x=100.0).world())[:, 0] == -1.0).all()


# Lane, speedometer, navigation


def test_the_lane_sensor_says_where_in_its_lane_the_ego_is() -> None:
    world = straight_road().with_ego(x=100.0, left=0.7, heading=0.2).world()
    assert read("lane", world) == pytest.approx([1.0, 0.7, 0.2, 3.2, 13.89], abs=1e-5)
    far = straight_road().with_ego(x=100.0, y=-60.0).world()
    assert read("lane", far).tolist() == [0.0] * 5


def test_the_speedometer_shows_speed_and_steering() -> None:
    world = straight_road().with_ego(x=100.0, speed=7.5).world()
    world = dataclasses.replace(world, egos=dataclasses.replace(world.egos, steering=np.array([-0.3])))
    assert read("speedometer", world) == pytest.approx([7.5, -0.3])


def test_navigation_counts_metres_and_names_the_next_turn() -> None:
    scene = lit_crossing()
    near, far = (scene.with_ego(x=x).world() for x in (-30.0, -60.0))
    assert read("navigation", near) == pytest.approx([Command.STRAIGHT, 229.0, 170.0], abs=0.01)
    assert read("navigation", far) == pytest.approx([Command.FOLLOW, 259.0, 140.0], abs=0.01)
    past = straight_road().with_ego(x=1005.0).world()
    assert read("navigation", past)[1] == 0.0


# Route


def test_the_route_lies_ahead_a_metre_apart() -> None:
    rows = read("route", straight_road().with_ego(x=100.0).world())
    expected = np.column_stack(
        [np.arange(80.0), *np.zeros((3, 80)), np.full(80, 13.89), np.full(80, 3.2), np.zeros(80)]
    )
    np.testing.assert_allclose(rows, expected, atol=1e-4)


def test_the_route_is_seen_from_where_the_ego_is() -> None:
    rows = read("route", straight_road().with_ego(x=100.0, left=1.5, heading=0.3).world())
    cos, sin = math.cos(0.3), math.sin(0.3)
    for i in (0, 10, 79):
        assert rows[i, :2] == pytest.approx([i * cos - 1.5 * sin, -i * sin - 1.5 * cos], abs=1e-4)
        assert rows[i, 2] == pytest.approx(-0.3, abs=1e-5)


def test_past_the_goal_the_last_point_repeats() -> None:
    rows = read("route", straight_road().with_ego(x=960.0).world())
    np.testing.assert_allclose(rows[:40, 0], np.arange(40.0), atol=1e-3)
    np.testing.assert_allclose(rows[39:, 0], 39.0, atol=1e-3)


def test_a_bend_to_the_left_curves_left_and_is_announced() -> None:
    mission = Mission(start=Place(lane="w_c_1"), goal=Place(lane="c_n_1", position_m=-1.0))
    rows = read("route", dataclasses.replace(lit_crossing(), mission=mission).with_ego(x=-50.0).world())
    assert rows[79, 1] > 25.0
    assert rows[79, 2] == pytest.approx(math.pi / 2, abs=0.05)
    assert rows[:, 3].max() > 0.05
    assert rows[:, 3].min() > -0.02
    assert rows[0, 6] == Command.FOLLOW
    assert rows[30, 6] == Command.LEFT


# Junctions ahead


@pytest.mark.parametrize("light", [LightState.RED, LightState.YELLOW, LightState.GREEN, LightState.OFF])
def test_the_next_light_its_distance_and_its_state(light: LightState) -> None:
    scene = lit_crossing()
    other = LightState.GREEN if light is LightState.RED else LightState.RED
    rows = read("junctions_ahead", scene.with_ego(x=-50.0).with_lights(other, s=light).world())
    front = -50.0 + 2.25
    assert rows[0] == pytest.approx([scene.stop_line("w_c_0") - front, 10.4 - front, light, RightOfWay.MAJOR], abs=0.01)
    np.testing.assert_array_equal(rows[1:, :2], 1000.0)
    np.testing.assert_array_equal(rows[1:, 2], -1.0)


def test_a_stop_sign_is_no_light_but_a_line() -> None:
    scene = stop_sign_crossing()
    row = read("junctions_ahead", scene.with_ego(x=-50.0).world())[0]
    assert row == pytest.approx([scene.stop_line("w_c_0") + 47.75, 58.15, -1.0, RightOfWay.STOP], abs=0.01)


@pytest.mark.parametrize(("x", "seen"), [(-113.0, False), (-112.0, True), (-5.0, True), (8.0, True), (8.5, False)])
def test_a_junction_is_seen_from_100_metres_until_the_front_has_left_it(x: float, seen: bool) -> None:
    row = read("junctions_ahead", lit_crossing().with_ego(x=x).world())[0]
    assert (row[0] < 1000.0) == seen
    if seen:
        assert row[:2] == pytest.approx([-10.4 - (x + 2.25), 10.4 - (x + 2.25)], abs=0.01)


# Who may use what


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("track", Track)
def test_a_sensor_needs_its_track(name: str, track: Track) -> None:
    (made,) = make_sensors([name])
    assert made.name == name
    if track >= made.track:
        assert make_sensors([name], track)[0].name == name
    else:
        with pytest.raises(InvalidInputError, match=f"sensor '{name}' needs track '{made.track.name.lower()}'"):
            make_sensors(["speedometer", name], track)


def test_what_needs_the_map_and_what_is_privileged() -> None:
    tracks = {name: make_sensors([name])[0].track for name in SENSORS}
    assert {name for name, track in tracks.items() if track is Track.PRIVILEGED} >= {
        "objects",
        "junctions_ahead",
        "conflicts",
    }
    assert {name for name, track in tracks.items() if track is Track.MAP} >= {"lane", "route"}


def test_an_unknown_sensor_gets_the_nearest_name() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'objects'"):
        make_sensors(["object"])
