"""What actions mean to the car."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.agents.hierarchical.options.actuation import (
    ACCELERATION_M_S2,
    Steering,
    action_of,
    command,
    steering_limit,
)
from dohyo.sumo_networks.ego.dynamics import VehicleParameters

CAR = VehicleParameters()
UNIT = st.floats(-1.0, 1.0)
SPEEDS = st.floats(0.0, 20.0)


def straight() -> np.ndarray:
    route = np.zeros((80, 7), dtype=np.float32)
    route[:, 0] = np.arange(80)
    return route


def test_nothing_asked_is_nothing_done():
    assert command(np.zeros(2, np.float32), 8.0, straight(), Steering.POLICY).tolist() == [0.0, 0.0]


def test_full_pedals_and_what_is_beyond_them():
    gas = command(np.array([1.0, 0.0], np.float32), 8.0, straight(), Steering.POLICY)
    brake = command(np.array([-7.0, 0.0], np.float32), 8.0, straight(), Steering.POLICY)
    assert (gas[0], brake[0]) == (ACCELERATION_M_S2, -ACCELERATION_M_S2)


@pytest.mark.parametrize(("pedals", "expected"), [(0.0, -2.0), (0.1, -2.0), (-0.5, -4.0), (0.2, 1.6)])
def test_a_stand_is_held_until_the_pedal_asks_for_more_than_1_m_s2(pedals, expected):
    action = np.array([pedals, 0.0], np.float32)
    assert command(action, 0.0, straight(), Steering.POLICY)[0] == pytest.approx(expected)
    assert command(action, 0.2, straight(), Steering.POLICY)[0] == pytest.approx(8.0 * pedals)


def test_full_steering_is_full_lock_at_a_crawl_and_a_bend_of_3_5_m_s2_at_speed():
    assert steering_limit(1.0) == CAR.max_steering
    curvature = math.tan(steering_limit(12.0)) / CAR.wheelbase
    assert curvature * 12.0**2 == pytest.approx(3.5)


@given(UNIT, UNIT, SPEEDS, st.sampled_from(list(Steering)))
def test_an_experts_controls_become_the_action_that_gives_them(pedals, wheel, speed, steering):
    action = np.array([pedals, wheel], dtype=np.float32)
    controls = command(action, speed, straight(), steering)
    again = command(action_of(controls, speed, straight(), steering), speed, straight(), steering)
    assert again == pytest.approx(controls, abs=1e-5)


def test_what_no_action_gives_is_cut_off():
    action = action_of(np.array([-9.0, 1.0]), 12.0, straight(), Steering.POLICY)
    assert action.tolist() == [-1.0, 1.0]


def test_a_policy_that_only_corrects_leaves_pure_pursuit_where_it_does_nothing():
    bend = straight()
    bend[:, 1] = 0.01 * bend[:, 0] ** 2
    own = command(np.zeros(2, np.float32), 6.0, bend, Steering.POLICY)
    helped = command(np.zeros(2, np.float32), 6.0, bend, Steering.RESIDUAL)
    assert own[1] == 0.0
    assert helped[1] > 0.02
