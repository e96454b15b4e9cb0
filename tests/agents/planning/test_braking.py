"""Vehicles that brake: their forecast by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dohyo.agents.experts.pdm import PdmClosed
from dohyo.agents.planning.braking import braking_on, decelerations
from dohyo.agents.planning.prediction import constant_speed
from dohyo.agents.planning.scene import Scene, SceneBuilder
from dohyo.sumo_networks.world import ActorKind
from tests.agents.driving import observed
from tests.worlds import straight_road

SPEED = 10.0


def braked(rate: float, speed: float = SPEED, kind: ActorKind = ActorKind.CAR, seen: bool = True) -> Scene:
    """One actor ahead that has lost speed at a rate [m/s^2] for half a second."""
    road = straight_road().with_ego(x=100.0).with_actor(130.0, speed, kind=kind)
    scene = SceneBuilder().update(observed(PdmClosed(), road.world()))
    actors = scene.actors
    history, moved = actors.history.copy(), 0.5 * speed + 0.5 * rate * 0.5**2
    history[:, -2, :2] = actors.position - (moved, 0.0)
    valid = np.full_like(actors.history_valid, seen)
    return dataclasses.replace(scene, actors=dataclasses.replace(actors, history=history, history_valid=valid))


def travelled(scene: Scene) -> np.ndarray:
    """(81,) distance driven in the forecast, m."""
    places = braking_on(scene, constant_speed(scene))[0, :, :2]
    return np.asarray(np.hypot(*(places - places[0]).T))


def test_its_deceleration_is_told_by_half_a_second() -> None:
    assert decelerations(braked(4.0).actors).tolist() == pytest.approx([4.0])
    assert decelerations(braked(-3.0).actors).tolist() == [0.0], "it speeds up"
    assert decelerations(braked(20.0).actors).tolist() == [8.0], "no road allows more"
    assert decelerations(braked(4.0, seen=False).actors).tolist() == [0.0]


def test_it_brakes_for_a_second_and_keeps_what_is_left() -> None:
    way = travelled(braked(4.0))
    assert way[[5, 10]].tolist() == pytest.approx([10.0 * 0.5 - 2.0 * 0.25, 10.0 - 2.0])
    np.testing.assert_allclose(np.diff(way[10:]), 0.6, rtol=1e-6)


def test_it_never_drives_backwards() -> None:
    way = travelled(braked(8.0, speed=4.0))
    assert way[-1] == pytest.approx(4.0**2 / 16.0), "it stands after half a second"
    assert (np.diff(way) >= -1e-12).all()


@pytest.mark.parametrize(
    "scene", [braked(0.5), braked(4.0, kind=ActorKind.PEDESTRIAN), braked(4.0, seen=False), braked(4.0, speed=0.0)]
)
def test_nobody_else_is_slowed(scene: Scene) -> None:
    forecast = constant_speed(scene)
    assert braking_on(scene, forecast) is forecast
