"""Labels and cameras: a displaced camera sees, and is told, what a displaced car would see and be told."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.agents.gri.vision.cameras import CAMERAS, MOUNTED, OFF, Rig, drawn_displacement, pictures
from dohyo.agents.gri.vision.labels import JUNCTION_M, LIGHT_M, SENSORS, Labels, labels_of
from dohyo.agents.hierarchical.vision.classes import Seen
from dohyo.sumo_networks.conditions import CONDITIONS, Conditions
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.sensors import Track, make_sensors
from dohyo.sumo_networks.world import LightState
from tests.worlds import Scene, lit_crossing, straight_road

AHEAD, ASIDE, TURN = 4.0, 1.0, 12.0
"""Displacement in m, m to the left, and degrees to the left."""


def displaced(x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> np.ndarray:
    return np.array([x, y, 0.0, yaw, 0.0, 0.0])


def told(scene: Scene, displacement: np.ndarray | None = None) -> Labels:
    observation = {sensor.name: sensor.read(scene.world(), 0) for sensor in make_sensors(SENSORS)}
    return labels_of(observation, displaced() if displacement is None else displacement)


def seen(scene: Scene, displacement: np.ndarray, conditions: str = "clear") -> tuple[np.ndarray, np.ndarray]:
    return Rig(displacement, CONDITIONS[conditions], np.random.default_rng(0)).read(scene.world(), 0)


def before_the_light(metres: float, state: LightState = LightState.RED, **more: float) -> Scene:
    """An ego whose front is so far before the line of a crossing."""
    at_line = told(lit_crossing().with_ego(x=-40.0).with_lights(LightState.RED))
    return lit_crossing().with_ego(x=-40.0 + at_line.distance_m - metres, **more).with_lights(state)


def test_labels_tell_junction_light_colour_distance_and_place_in_the_lane():
    assert told(before_the_light(30.0)) == Labels(
        False, 1, pytest.approx(30.0, abs=0.05), pytest.approx(0.0), pytest.approx(0.0, abs=0.01)
    )
    assert told(before_the_light(JUNCTION_M - 1.0, LightState.GREEN)).junction
    assert [told(before_the_light(9.0, state)).light for state in (1, 2, 3, 0)] == [1, 2, 3, 0]
    assert told(before_the_light(LIGHT_M + 2.0)).light == 0
    assert told(before_the_light(30.0, heading=0.2)).angle_rad == pytest.approx(0.2, abs=0.01)
    assert told(before_the_light(30.0, left=0.8)).offset_m == pytest.approx(0.8, abs=0.02)
    turned = told(before_the_light(30.0, left=-0.5, heading=0.3))
    assert turned.offset_m == pytest.approx(-0.5, abs=0.02), "of its place alone"
    inside = told(before_the_light(-1.0))
    assert (inside.junction, inside.light, inside.distance_m) == (True, 0, 0.0)


def test_a_moved_camera_moves_the_labels():
    here = before_the_light(30.0)
    moved = told(here, displaced(AHEAD, ASIDE, TURN))
    assert moved.distance_m == pytest.approx(told(here).distance_m - AHEAD, abs=0.05)
    assert moved.angle_rad == pytest.approx(math.radians(TURN), abs=0.01)
    assert moved.offset_m == pytest.approx(ASIDE, abs=0.02)
    assert told(before_the_light(2.0), displaced(AHEAD)).light == 0, "the line is behind the camera"
    assert told(before_the_light(JUNCTION_M + 1.0), displaced(AHEAD)).junction


@pytest.mark.parametrize(("x", "y", "yaw"), [(AHEAD, 0.0, 0.0), (0.0, ASIDE, 0.0), (AHEAD, -ASIDE, 0.0)])
def test_a_moved_camera_is_told_and_shown_what_a_moved_car_is(x: float, y: float, yaw: float):
    there = before_the_light(30.0 - x, left=y)
    camera, car = told(before_the_light(30.0), displaced(x, y, yaw)), told(there)
    assert camera[:2] == car[:2]
    assert camera[2:] == pytest.approx(car[2:], abs=0.05)
    for mine, theirs in zip(seen(before_the_light(30.0), displaced(x, y, yaw)), seen(there, displaced()), strict=True):
        assert (mine != theirs).mean() < 0.02, "but for edges of pixels"
    assert (seen(before_the_light(30.0), displaced())[0] != seen(there, displaced())[0]).mean() > 0.05


def test_a_turned_camera_sees_what_was_at_its_side():
    scene = straight_road().with_ego(x=300.0).with_actor(320.0)
    _, ahead = seen(scene, displaced())
    _, turned = seen(scene, displaced(yaw=TURN))
    column = [np.flatnonzero((one[1] == Seen.VEHICLE).any(axis=0)).mean() for one in (ahead, turned)]
    assert column[1] > column[0] + 5.0, "turned to the left, it sees the car farther to the right"


def test_the_rig_as_mounted_is_what_an_agent_gets():
    scene = before_the_light(20.0)
    sensors = make_sensors(CAMERAS, Track.SENSORS, Conditions())
    observation = {sensor.name: sensor.read(scene.world(), 0) for sensor in sensors}
    colours, classes = seen(scene, np.array(MOUNTED))
    assert np.array_equal(colours, pictures(observation))
    assert (colours.shape, classes.shape) == ((3, 3, 64, 64), (3, 64, 64))
    assert (classes[1] == Seen.RED).any()
    assert not np.array_equal(colours, seen(scene, np.array(MOUNTED), "heavy-rain")[0]), "conditions are in the picture"


def test_displacements_are_drawn_within_bounds_and_others_are_refused():
    rng = np.random.default_rng(0)
    drawn = np.array([drawn_displacement(rng) for _ in range(200)])
    bounds = np.array(list(OFF.values()))
    assert (np.abs(drawn) <= bounds).all()
    assert (np.abs(drawn).max(axis=0) > 0.9 * bounds).all()
    with pytest.raises(InvalidInputError, match="expected a camera and its displacement"):
        Rig(np.zeros(3), Conditions(), rng)
