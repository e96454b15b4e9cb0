"""The view of PRIBOOT: its colours are those of the sensor, and a displaced world is drawn as it would look."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.agents.priboot.recording.displacement import displaced
from dohyo.agents.priboot.view import CONFIG, SENSOR, colours_of, masks_of, packed
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.world import World
from tests.worlds import straight_road


def layers(world: World) -> np.ndarray:
    (sensor,) = make_sensors([SENSOR])
    return packed(sensor.read(world, 0))


def test_packed_layers_become_the_masks_and_the_picture_of_the_sensor() -> None:
    world = straight_road().with_ego(x=100.0).with_actor(110.0, 5.0).world()
    masks, rgb = make_sensors([SENSOR, CONFIG.model_copy(update={"name": "rgb", "mode": "rgb"})])
    bits = packed(masks.read(world, 0))[None]
    np.testing.assert_array_equal(masks_of(bits)[0], masks.read(world, 0))
    np.testing.assert_array_equal(colours_of(bits)[0], rgb.read(world, 0))


def test_a_displaced_ego_sees_what_an_ego_there_would_see() -> None:
    here = straight_road().with_ego(x=100.0).world()
    there = straight_road().with_ego(x=100.5, left=0.8, heading=0.1).world()
    moved = displaced(here, 0, np.array([0.5, 0.8, 0.1]))
    assert moved.egos.position[0] == pytest.approx(there.egos.position[0])
    assert moved.egos.heading[0] == pytest.approx(there.egos.heading[0])
    np.testing.assert_array_equal(layers(moved), layers(there))


def test_a_displacement_is_in_the_frame_of_the_ego() -> None:
    here = straight_road().with_ego(x=100.0, heading=math.pi / 2).world()
    moved = displaced(here, 0, np.array([2.0, 1.0, 0.0]))
    assert moved.egos.position[0] - here.egos.position[0] == pytest.approx([-1.0, 2.0])
