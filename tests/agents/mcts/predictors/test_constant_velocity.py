"""Constant velocity and CTRA, by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dohyo.agents.mcts.predictors.constant_velocity import ConstantVelocity
from dohyo.agents.planning.scene import Scene
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.mcts.predictors.scenes import Body, scene


def with_history(now: Scene, poses: np.ndarray) -> Scene:
    return replace(now, actors=replace(now.actors, history=poses[None]))


def test_an_actor_goes_straight_on_at_its_speed():
    forecast = ConstantVelocity().predict(scene([Body(10.0, 2.0, speed=5.0, heading=math.pi / 2)]))
    assert forecast.actors.shape == (1, 81, 3)
    assert forecast.actors[0, 0] == pytest.approx([10.0, 2.0, math.pi / 2])
    assert forecast.actors[0, 80] == pytest.approx([10.0, 42.0, math.pi / 2])


def test_the_ego_is_forecast_like_everybody_else():
    forecast = ConstantVelocity().predict(scene(ego_speed=3.0))
    assert forecast.actors.shape == (0, 81, 3)
    assert forecast.ego is not None
    assert forecast.ego[80] == pytest.approx([24.0, 0.0, 0.0])


def test_ctra_keeps_acceleration():
    # 8 m/s now, 9 m in the last second: it was at 9 m/s half a second ago, so it brakes with 2 m/s^2 and stops in 16 m.
    braking = np.array([[-15.0, 0, 0], [-9.0, 0, 0], [-4.25, 0, 0], [0.0, 0, 0]])
    poses = ConstantVelocity("ctra").predict(with_history(scene([Body(0.0, 0.0, speed=8.0)]), braking)).actors[0]
    assert poses[10, 0] == pytest.approx(7.0)
    assert poses[80, 0] == pytest.approx(16.0)
    assert poses[:, 1] == pytest.approx(np.zeros(81))


def test_ctra_keeps_its_turn_rate():
    # 5 m/s on a circle of 20 m: a quarter of a radian a second.
    angle = -0.25 * np.array([1.5, 1.0, 0.5, 0.0])
    circle = np.column_stack([20 * np.sin(angle), 20 * (1 - np.cos(angle)), angle])
    poses = ConstantVelocity("ctra").predict(with_history(scene([Body(0.0, 0.0, speed=5.0)]), circle)).actors[0]
    assert poses[40, :2] == pytest.approx([20 * math.sin(1.0), 20 * (1 - math.cos(1.0))], abs=0.2)
    assert poses[40, 2] == pytest.approx(1.0, abs=0.01)


def test_ctra_needs_the_last_second():
    now = scene([Body(0.0, 0.0, speed=5.0)])
    circle = np.column_stack([np.arange(-3.0, 1.0), np.zeros(4), np.arange(-3, 1) / 10])
    new = with_history(now, circle)
    seen = np.array([[False, False, True, True]])
    poses = ConstantVelocity("ctra").predict(replace(new, actors=replace(new.actors, history_valid=seen))).actors[0]
    assert poses[80] == pytest.approx([40.0, 0.0, 0.0])


def test_who_stands_stays():
    poses = ConstantVelocity("ctra").predict(scene([Body(7.0, 1.0)])).actors[0]
    assert (poses == poses[0]).all()


def test_an_unknown_model_is_refused():
    with pytest.raises(InvalidInputError, match="'velocity' or 'ctra'"):
        ConstantVelocity("kalman")  # type: ignore[arg-type]
