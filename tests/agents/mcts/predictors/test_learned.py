"""The learned predictor as it is shipped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dohyo.agents.mcts.predicting import make_predictor
from dohyo.agents.mcts.predictors.learned import SHIPPED, Learned, dense
from dohyo.agents.planning.prediction import NEAREST, constant_velocity
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.mcts.predictors.scenes import Body, busy, scene, straight


def test_the_shipped_predictor_is_small_and_there_by_name():
    assert SHIPPED.stat().st_size < 5_000_000
    assert isinstance(make_predictor("learned"), Learned)


def test_forecasts_begin_where_everybody_is():
    now = busy(4, actors=40)
    forecast = Learned().predict(now)
    assert forecast.actors.shape == (40, 81, 3)
    np.testing.assert_allclose(forecast.actors[:, 0, :2], now.actors.position, atol=1e-9)
    assert forecast.ego is not None
    assert (forecast.ego[0] == 0.0).all()
    assert np.isfinite(forecast.actors).all()


def test_actors_beyond_the_nearest_keep_their_velocity():
    now = busy(4, actors=40)
    np.testing.assert_array_equal(Learned().predict(now).actors[NEAREST:], constant_velocity(now)[NEAREST:])


def test_the_same_scene_gives_the_same_forecast_whatever_came_before():
    used, now = Learned(), busy(7)
    used.predict(busy(8))
    np.testing.assert_array_equal(used.predict(now).actors, Learned().predict(now).actors)


def test_an_empty_scene_is_forecast():
    forecast = Learned().predict(scene(ego_speed=5.0))
    assert forecast.actors.shape == (0, 81, 3)
    assert np.isfinite(forecast.ego).all()


def test_it_has_learned_to_stay_in_a_bent_lane():
    """A car in a left bend: straight on would take it off the road."""
    angle = np.linspace(0.0, np.pi / 2, 20)
    bend = tuple(zip(20 * np.sin(angle), 20 * (1 - np.cos(angle)) + 30.0, strict=True))
    after = straight(0.0, 0.0)
    lanes = [straight(-30.0, 0.0, y=30.0, following=(1,))]
    lanes.append(type(after)(bend, following=(2,)))
    lanes.append(type(after)(((20.0, 50.0), (20.0, 85.0))))
    now = scene([Body(-8.0, 30.0, speed=7.0)], lanes)
    learned, straight_on = Learned().predict(now).actors[0, 50], constant_velocity(now)[0, 50]
    on_road = now.lanes.points.reshape(-1, 2)
    off = [np.hypot(*(on_road - pose[:2]).T).min() for pose in (learned, straight_on)]
    assert off[0] < 0.5 * off[1]


def test_poses_in_between_lie_on_straight_lines_and_turn_the_short_way():
    start = np.array([[0.0, 0.0, 3.0]])
    knots = np.zeros((1, 16, 3))
    knots[0, :, 0], knots[0, :, 2] = np.arange(1, 17) * 5.0, -3.0
    out = dense(start, knots)
    assert out.shape == (1, 81, 3)
    np.testing.assert_allclose(out[0, :, 0], np.arange(81))
    assert np.abs(out[0, :6, 2]).min() > 2.9  # across pi, not across 0
    np.testing.assert_allclose(out[0, 5::5], knots[0], atol=1e-12)


def test_what_is_no_model_is_refused(tmp_path: Path):
    (tmp_path / "m.onnx").write_bytes(b"nothing")
    for name in ("m.onnx", "other.onnx"):
        with pytest.raises(InvalidInputError, match=name):
            Learned(tmp_path / name)
