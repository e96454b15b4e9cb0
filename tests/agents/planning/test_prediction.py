"""Forecasts without a network: straight on, and on along a turn."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dohyo.agents.experts.pdm import PdmClosed
from dohyo.agents.planning.prediction import STEP_S, constant_speed, constant_velocity
from dohyo.agents.planning.scene import Scene, SceneBuilder
from dohyo.sumo_networks.world import ActorKind
from tests.agents.driving import observed
from tests.worlds import straight_road

SPEED, RADIUS = 8.0, 30.0


def on_a_circle(kind: ActorKind = ActorKind.CAR, seen: bool = True) -> Scene:
    """One actor that drives to the left around a point 30 m beside it."""
    road = straight_road().with_ego(x=100.0).with_actor(130.0, SPEED, kind=kind)
    scene = SceneBuilder().update(observed(PdmClosed(), road.world()))
    actors, rate = scene.actors, SPEED / RADIUS
    history = actors.history.copy()
    history[:, :, 2] = actors.heading[:, None] - rate * np.array([1.5, 1.0, 0.5, 0.0])
    valid = np.full_like(actors.history_valid, seen)
    return dataclasses.replace(scene, actors=dataclasses.replace(actors, history=history, history_valid=valid))


def truth(scene: Scene, after_s: float) -> np.ndarray:
    angle = after_s * SPEED / RADIUS
    return np.asarray(scene.actors.position[0] + RADIUS * np.array([math.sin(angle), 1.0 - math.cos(angle)]))


def test_a_car_that_turns_goes_on_turning() -> None:
    scene = on_a_circle()
    bent, straight = constant_speed(scene)[0], constant_velocity(scene)[0]
    for after_s, farthest in ((0.5, 0.05), (1.0, 0.25), (2.0, 1.5)):
        row = round(after_s / STEP_S)
        off = np.hypot(*(bent[row, :2] - truth(scene, after_s)))
        assert off < farthest
        assert off < 0.5 * np.hypot(*(straight[row, :2] - truth(scene, after_s)))
    assert bent[0].tolist() == straight[0].tolist()
    np.testing.assert_allclose(np.hypot(*np.diff(bent[:, :2], axis=0).T), SPEED * STEP_S, rtol=1e-9)
    assert bent[-1, 2] < math.radians(30), "a turn ends"


def test_who_was_just_seen_and_people_go_straight_on() -> None:
    for scene in (on_a_circle(seen=False), on_a_circle(ActorKind.PEDESTRIAN)):
        np.testing.assert_allclose(constant_speed(scene), constant_velocity(scene))
