"""Who is ahead in the lane is not believed to clear it sooner than it has to."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.agents.mcts.caution import cautious
from dohyo.agents.mcts.predictors.constant_velocity import ConstantVelocity
from dohyo.agents.planning.prediction import STEPS
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.world import ActorKind
from tests.agents.mcts.predictors.scenes import Body, scene

TIMES = np.arange(STEPS) * 0.1


def forecast(x: float, y: float, heading: float, speed: float, acceleration: float = 0.0) -> FloatArray:
    """(1, 81, 3) straight on, faster and faster."""
    way = speed * TIMES + 0.5 * acceleration * TIMES**2
    turn = np.full(STEPS, heading)
    return np.stack([x + way * math.cos(heading), y + way * math.sin(heading), turn], axis=-1)[None]


def test_a_leader_that_is_predicted_to_speed_up_keeps_its_speed() -> None:
    held = cautious(scene([Body(20.0, 0.0, 6.0)]), forecast(20.0, 0.0, 0.0, 6.0, 1.0))
    assert held[0, :, 0] == pytest.approx(20.0 + 6.0 * TIMES, abs=1e-6)


def test_a_leader_that_is_predicted_to_brake_is_believed() -> None:
    slower = forecast(20.0, 0.0, 0.0, 6.0, -0.7)
    assert cautious(scene([Body(20.0, 0.0, 6.0)]), slower) == pytest.approx(slower)


def test_a_leader_that_brakes_goes_on_braking_for_a_second() -> None:
    here = scene([Body(20.0, 0.0, 6.0)])
    here.actors.history[0, -2, 0] = 20.0 - 0.5 * 7.0  # a quarter of a second ago it drove 7 m/s: it brakes by 4 m/s^2
    held = cautious(here, forecast(20.0, 0.0, 0.0, 6.0))
    speed = np.diff(held[0, :, 0]) / 0.1
    assert speed[-1] == pytest.approx(2.0, abs=1e-6)
    assert speed[9] == pytest.approx(2.0, abs=1e-6)
    here.actors.history_valid[0, -2] = False
    assert np.diff(cautious(here, forecast(20.0, 0.0, 0.0, 6.0))[0, :, 0])[-1] == pytest.approx(0.6, abs=1e-6)


def test_who_walks_in_the_lane_may_stop_for_a_second() -> None:
    walker = Body(20.0, -1.0, 1.5, heading=math.pi / 2, kind=ActorKind.PEDESTRIAN)
    held = cautious(scene([walker]), forecast(20.0, -1.0, math.pi / 2, 1.5))
    assert held[0, 10, 1] == pytest.approx(-1.0)
    assert held[0, 30, 1] == pytest.approx(-1.0 + 1.5 * 2.0, abs=1e-6)


@pytest.mark.parametrize(
    "other",
    [
        Body(20.0, 4.0, 6.0),  # in the next lane
        Body(-20.0, 0.0, 6.0),  # behind
        Body(20.0, 0.0, 6.0, heading=math.pi),  # comes towards the ego
    ],
)
def test_everybody_else_is_taken_as_predicted(other: Body) -> None:
    predicted = forecast(other.x, other.y, other.heading, other.speed, 1.0)
    assert cautious(scene([other]), predicted) is predicted


@pytest.mark.parametrize(("x", "y"), [(20.0, -3.0), (-9.0, 0.0), (15.0, 30.0)])
def test_people_on_foot_walk_straight_on_whatever_is_predicted(x: float, y: float) -> None:
    walker = Body(x, y, 1.5, heading=math.pi / 2, kind=ActorKind.PEDESTRIAN)
    stays, driver = forecast(x, y, 0.0, 0.0), forecast(40.0, 6.0, 0.1, 3.0)
    predicted = np.concatenate([stays, driver])
    held = cautious(scene([walker, Body(40.0, 6.0, 3.0, heading=0.1)]), predicted)
    assert held[0, 1:] == pytest.approx(forecast(x, y, math.pi / 2, 1.5)[0, 1:], abs=1e-9)
    np.testing.assert_array_equal(held[1], driver[0])
    np.testing.assert_array_equal(predicted[0], stays[0])  # what the predictor said is not overwritten


@given(
    people=st.lists(st.tuples(st.floats(-50, 50), st.floats(3, 50), st.floats(-3, 3), st.floats(0, 3)), min_size=1),
)
def test_nothing_changes_for_the_constant_velocity_predictor(people: list[tuple[float, float, float, float]]) -> None:
    bodies = [Body(x, y, speed, heading=turn, kind=ActorKind.PEDESTRIAN) for x, y, turn, speed in people]
    here = scene(bodies)
    predicted = ConstantVelocity().predict(here).actors
    np.testing.assert_array_equal(cautious(here, predicted), predicted)


@given(speed=st.floats(0.0, 15.0), acceleration=st.floats(0.0, 3.0), turn=st.floats(-0.5, 0.5))
def test_a_leader_stays_on_its_predicted_way_and_never_gets_further(
    speed: float, acceleration: float, turn: float
) -> None:
    predicted = forecast(15.0, 0.0, turn, speed, acceleration)
    held = cautious(scene([Body(15.0, 0.0, speed, heading=turn)]), predicted)
    way, far = held[0, :, :2] - (15.0, 0.0), predicted[0, :, :2] - (15.0, 0.0)
    assert np.abs(way @ (-math.sin(turn), math.cos(turn))).max() < 1e-6
    assert (np.hypot(*way.T) <= np.hypot(*far.T) + 1e-6).all()
    assert (np.diff(np.hypot(*way.T)) <= 0.1 * speed + 1e-6).all()
