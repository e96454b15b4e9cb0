"""Manoeuvres: where their path leads, when they may begin, and when they are over."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.agents.hierarchical.options.manoeuvres import (
    Course,
    Manoeuvre,
    deviation,
    lane_is_free,
    light_ahead,
    line_near,
)
from dohyo.agents.planning.surroundings import Surroundings
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.world import LightState
from tests.worlds import LANE_M, Scene, lit_crossing, straight_road

SENSORS = ("route", "path", "junctions_ahead", "objects", "lanes", "navigation", "speedometer")
Observation = dict[str, np.ndarray]


def seen(scene: Scene) -> Observation:
    world = scene.world()
    return {sensor.name: sensor.read(world, 0) for sensor in make_sensors(SENSORS)}


def ego(x: float = 100.0, **more: float) -> Scene:
    return straight_road().with_ego(x=x, speed=8.0, **more)


def changed(course: Course, scene: Scene, manoeuvre: Manoeuvre = Manoeuvre.LEFT) -> bool:
    observation = seen(scene)
    course.look(Surroundings(observation))
    return course.begin(manoeuvre, float(observation["navigation"][2]), 8.0)


@pytest.mark.parametrize(("left", "turned"), [(0.0, 0.0), (0.7, 0.1), (-1.2, -0.3)])
def test_deviation_is_to_the_left_and_counter_clockwise(left, turned):
    lateral, angle = deviation(seen(ego(left=left, heading=turned))["path"])
    assert lateral == pytest.approx(left, abs=0.02)
    assert angle == pytest.approx(turned, abs=0.01)


def test_without_a_change_the_path_is_the_routes():
    observation = seen(ego())
    assert Course().seen(observation) is observation


def test_a_change_leads_smoothly_into_the_lane_on_the_left():
    course = Course()
    assert changed(course, ego())
    assert course.offset == pytest.approx(LANE_M, abs=0.1)
    observation = course.seen(seen(ego()))
    lefts = observation["route"][:, 1]
    assert lefts[0] == pytest.approx(0.0, abs=0.05)
    assert lefts[60] == pytest.approx(LANE_M, abs=0.1)
    assert np.diff(lefts).min() >= -1e-5
    assert np.abs(observation["route"][:, 2]).max() < math.radians(15.0)
    ahead = observation["path"][12:92, 1]
    assert ahead == pytest.approx(lefts, abs=1e-4)


def test_it_has_arrived_in_the_middle_of_that_lane_and_not_before():
    course = Course()
    changed(course, ego())
    assert not course.arrived(seen(ego()))
    assert not course.arrived(seen(ego(x=160.0)))
    assert not course.arrived(seen(ego(x=160.0, left=LANE_M, heading=0.3)))
    assert course.arrived(seen(ego(x=160.0, left=LANE_M)))


def test_back_to_the_route_is_a_change_to_the_right():
    course = Course()
    changed(course, ego())
    there = ego(x=160.0, left=LANE_M)
    course.look(Surroundings(seen(there)))
    assert course.beside(Manoeuvre.LEFT) is None
    assert course.beside(Manoeuvre.RIGHT) == 0.0
    assert changed(course, there, Manoeuvre.RIGHT)
    assert course.arrived(seen(ego(x=240.0)))


def test_there_is_no_lane_on_the_right_of_the_rightmost_and_oncoming_ones_do_not_count():
    course = Course()
    course.look(Surroundings(seen(ego())))
    assert course.beside(Manoeuvre.RIGHT) is None
    assert not course.free(Manoeuvre.RIGHT, 8.0)
    assert course.free(Manoeuvre.LEFT, 8.0)
    assert not changed(course, ego(), Manoeuvre.RIGHT)
    assert course.offset == 0.0


@pytest.mark.parametrize(
    ("x", "speed", "free"),
    [
        (100.0, 8.0, False),  # beside
        (108.0, 8.0, False),  # close ahead
        (125.0, 8.0, True),
        (125.0, 0.0, False),  # stands, and the ego comes up fast
        (88.0, 8.0, True),
        (88.0, 14.0, False),  # comes up fast from behind
        (70.0, 12.0, True),
    ],
)
def test_a_lane_is_free_where_nobody_is_hindered(x, speed, free):
    around = Surroundings(seen(ego().with_actor(x=x, speed=speed, left=LANE_M)))
    assert lane_is_free(around, LANE_M, 8.0) is free


def test_where_the_lane_beside_ends_the_path_leads_back():
    crossing = lit_crossing()
    course = Course()
    far, near = crossing.with_ego(x=-150.0, speed=8.0), crossing.with_ego(x=-30.0, speed=8.0, left=LANE_M)
    assert changed(course, far)
    for scene, offset in ((far, pytest.approx(LANE_M, abs=0.1)), (near, 0.0)):
        observation = seen(scene)
        course.look(Surroundings(observation))
        course.keep_to_roads(float(observation["navigation"][2]), 8.0)
        assert course.offset == offset


def test_a_light_counts_from_60_m_before_it_until_its_junction_is_left():
    crossing = lit_crossing()
    line = crossing.stop_line("w_c_0")
    at = {x: light_ahead(seen(crossing.with_ego(x=x).with_lights(LightState.GREEN))["junctions_ahead"]) for x in
          (line - 70.0, line - 55.0, line - 3.0, 0.0, 60.0)}  # fmt: skip
    assert list(at.values()) == [False, True, True, True, False]
    assert not light_ahead(seen(ego())["junctions_ahead"])


@pytest.mark.parametrize(
    ("distance", "state", "near"),
    [
        (34.0, LightState.RED, True),
        (34.0, LightState.YELLOW, True),
        (36.0, LightState.RED, False),
        (34.0, LightState.GREEN, False),
        (-1.0, LightState.RED, False),
    ],
)
def test_only_a_light_ahead_that_is_near_and_not_green_is_for_lights_alone(distance, state, near):
    lights = np.full((4, 4), 1000.0, dtype=np.float32)
    lights[:, 2] = -1
    lights[0, 0], lights[0, 2] = distance, state
    assert line_near(lights) is near
