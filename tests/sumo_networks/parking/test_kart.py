"""The kart: rest, speed, brake, rolling resistance, turning circle, grip."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.sumo_networks.parking import kart


def driven(action: tuple[float, float, float], seconds: float, speed_mps: float = 0.0) -> np.ndarray:
    """States after each substep."""
    state = np.zeros((1, kart.STATE))
    state[0, kart.COS], state[0, kart.SPEED] = 1.0, speed_mps
    states = []
    for _ in range(round(seconds / kart.SUBSTEP_S)):
        kart.drive(state, 0, *action)
        states.append(state[0].copy())
    return np.array(states)


def test_a_kart_at_rest_stays_at_rest_whatever_it_steers_and_brakes():
    states = driven((0.0, 1.0, 1.0), 5.0)
    assert not states[:, [kart.X, kart.Y, kart.HEADING, kart.SPEED, kart.DRIVEN]].any()
    assert states[-1, kart.STEERING] == pytest.approx(kart.MAX_STEERING_RAD, rel=1e-6)


def test_full_torque_reaches_the_highest_speed_less_the_rolling_resistance():
    most = kart.MAX_MOTOR_TORQUE_NM / (kart.WHEEL_RADIUS_M * kart.MASS_KG)
    expected = kart.MAX_SPEED_MPS * (1 - kart.ROLLING_RESISTANCE * kart.GRAVITY_MPS2 / most)
    assert driven((1.0, 0.0, -1.0), 60.0)[-1, kart.SPEED] == pytest.approx(expected, rel=1e-3)
    assert driven((-1.0, 0.0, -1.0), 60.0)[-1, kart.SPEED] == pytest.approx(-expected, rel=1e-3)


def test_a_torque_below_the_rolling_resistance_moves_nothing():
    enough = kart.ROLLING_RESISTANCE * kart.GRAVITY_MPS2 * kart.MASS_KG * kart.WHEEL_RADIUS_M / kart.MAX_MOTOR_TORQUE_NM
    assert driven((0.99 * enough, 0.0, 0.0), 5.0)[-1, kart.DRIVEN] == 0.0
    assert driven((1.05 * enough, 0.0, 0.0), 5.0)[-1, kart.DRIVEN] > 0.0


def test_a_rolling_kart_only_slows_and_stops_where_energy_says():
    states = driven((0.0, 0.0, -1.0), 60.0, speed_mps=3.0)
    assert (np.diff(states[:, kart.SPEED]) <= 0).all()
    assert states[-1, kart.SPEED] == 0.0
    expected = 3.0**2 / (2 * kart.ROLLING_RESISTANCE * kart.GRAVITY_MPS2)
    assert states[-1, kart.X] == pytest.approx(expected, rel=1e-3)


def test_the_brake_stops_within_its_deceleration_and_lag():
    most = kart.MAX_BRAKE_TORQUE_NM / (kart.WHEEL_RADIUS_M * kart.MASS_KG)
    states = driven((0.0, 0.0, 1.0), 5.0, speed_mps=3.0)
    ideal = 3.0**2 / (2 * (most + kart.ROLLING_RESISTANCE * kart.GRAVITY_MPS2))
    assert ideal < states[-1, kart.X] < ideal + 3.0 * 1.5 * kart.BRAKE_LAG_S
    assert states[-1, kart.SPEED] == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_full_steering_is_a_circle_whose_radius_is_wheelbase_over_tangent(side):
    states = driven((0.15, side, -1.0), 40.0)[800:]
    cos, sin = states[:, kart.COS], states[:, kart.SIN]
    rear = states[:, [kart.X, kart.Y]] - 0.5 * kart.WHEELBASE_M * np.column_stack([cos, sin])
    radius = kart.WHEELBASE_M / math.tan(kart.MAX_STEERING_RAD)
    centre = rear + side * radius * np.column_stack([-sin, cos])
    assert np.abs(centre - centre[0]).max() < 2e-3
    assert np.allclose(np.arctan2(sin, cos), states[:, kart.HEADING], atol=1e-9)
    assert np.allclose(np.hypot(cos, sin), 1.0, atol=1e-12)


def test_a_fast_kart_turns_no_sharper_than_its_grip_allows():
    states = driven((1.0, 1.0, -1.0), 30.0)
    turned = np.diff(np.unwrap(states[:, kart.HEADING])) / kart.SUBSTEP_S
    lateral = turned * states[1:, kart.SPEED]
    assert lateral.max() == pytest.approx(kart.GRIP * kart.GRAVITY_MPS2, rel=1e-3)
