from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import (
    ACCELERATION,
    DRIVE,
    GRAVITY,
    HEADING,
    SPEED,
    STEERING,
    YAW_RATE,
    VehicleParameters,
    Vehicles,
    advance,
    car_constants,
)
from dohyo.sumo_networks.units import TICK_S

CAR = VehicleParameters()
IN_A_VACUUM = VehicleParameters(drag=0.0, rolling_resistance=0.0)


def driven(
    *commands: tuple[float, float], parameters: VehicleParameters = CAR, speed: float = 0.0, seconds: float = 0.1
) -> list[FloatArray]:
    """The state of one car at the start and after each command, held for so many seconds."""
    vehicles = Vehicles(parameters, 1)
    vehicles.place(0, 0.0, 0.0, 0.0)
    vehicles.states[0, SPEED] = speed
    states = [vehicles.states[0].copy()]
    for command in commands:
        vehicles.advance(np.array([command]), seconds)
        states.append(vehicles.states[0].copy())
    return states


def positions(states: list[FloatArray]) -> FloatArray:
    return np.array(states)[:, :2]


commands = st.lists(st.tuples(st.floats(-20, 20), st.floats(-2, 2)), min_size=1, max_size=40)
speeds = st.floats(0, 40)


def test_a_car_is_placed_by_the_centre_of_its_box() -> None:
    vehicles = Vehicles(CAR, 2)
    vehicles.place(1, 10.0, 20.0, math.pi / 2)
    assert vehicles.centres()[1] == pytest.approx([10.0, 20.0])
    assert vehicles.states[1, :2] == pytest.approx([10.0, 20.0 - CAR.axle_to_centre])
    assert CAR.axle_to_centre == pytest.approx(4.5 / 2 - 0.9)


def test_acceleration_follows_the_drive_with_its_lag() -> None:
    start, end = driven((2.0, 0.0), parameters=IN_A_VACUUM, seconds=5.0)
    lag, a, t = CAR.drive_lag, 2.0, 5.0
    assert end[SPEED] == pytest.approx(a * (t - lag * (1 - math.exp(-t / lag))), rel=0.005)
    distance = a * (t**2 / 2 - lag * t + lag**2 * (1 - math.exp(-t / lag)))
    assert end[0] - start[0] == pytest.approx(distance, rel=0.01)
    assert end[ACCELERATION] == pytest.approx(2.0, abs=1e-6)
    assert end[1] == end[HEADING] == 0.0


def test_full_brake_stops_within_the_distance_of_the_books() -> None:
    states = driven((-8.0, 0.0), parameters=IN_A_VACUUM, speed=20.0, seconds=6.0)
    lag = CAR.drive_lag
    assert states[-1][SPEED] == 0.0
    assert states[-1][0] - states[0][0] == pytest.approx(20.0**2 / (2 * 8.0) + 20.0 * lag, rel=0.02)


def test_the_brakes_never_exceed_what_the_tyres_hold() -> None:
    ice = VehicleParameters(friction=0.3, drag=0.0, rolling_resistance=0.0)
    states = driven((-8.0, 0.0), parameters=ice, speed=10.0, seconds=8.0)
    assert states[-1][0] - states[0][0] == pytest.approx(10.0**2 / (2 * 0.3 * GRAVITY), rel=0.03)


def test_a_rolling_car_comes_to_rest_by_its_resistance() -> None:
    states = driven((0.0, 0.0), speed=2.0, seconds=30.0)
    assert states[-1][SPEED] == 0.0
    assert states[-1][0] - states[0][0] == pytest.approx(2.0**2 / (2 * CAR.rolling_resistance), rel=0.02)


def test_a_braked_car_stands_still() -> None:
    first, *rest = driven(*[(-8.0, 0.5)] * 10)
    for state in rest:
        np.testing.assert_array_equal(state[[0, 1, HEADING, SPEED, ACCELERATION, YAW_RATE]], first[[0, 1, 2, 3, 6, 7]])


def test_traction_is_bounded_by_engine_power() -> None:
    _, state = driven((4.0, 0.0), parameters=IN_A_VACUUM, speed=30.0, seconds=1.0)
    assert state[ACCELERATION] == pytest.approx(CAR.power_to_mass / state[SPEED], rel=0.02)
    assert CAR.traction_limit(0.0) == CAR.max_traction
    assert CAR.traction_limit(30.0) == pytest.approx(65.0 / 30.0)


def test_top_speed_is_where_power_meets_resistance() -> None:
    *_, state = driven((4.0, 0.0), speed=50.0, seconds=120.0)
    assert CAR.traction_limit(state[SPEED]) == pytest.approx(CAR.resistance(state[SPEED]), rel=0.01)


@pytest.mark.parametrize("steering", [0.05, -0.05, 0.2, -0.4])
def test_slow_circles_have_the_radius_of_the_bicycle(steering: float) -> None:
    hold = (CAR.resistance(3.0), steering)
    states = driven(*[hold] * 200, speed=3.0)
    x, y = positions(states[50:]).T
    # Least-squares circle through the path of the rear axle.
    a, b, c = np.linalg.lstsq(np.column_stack([x, y, np.ones_like(x)]), x**2 + y**2, rcond=None)[0]
    radius = math.sqrt(c + a**2 / 4 + b**2 / 4)
    assert radius == pytest.approx(CAR.wheelbase / math.tan(abs(steering)), rel=1e-3)
    assert states[-1][YAW_RATE] == pytest.approx(states[-1][SPEED] * math.tan(steering) / CAR.wheelbase, rel=1e-3)


def test_steering_left_turns_left() -> None:
    *_, state = driven((0.0, 0.1), speed=5.0, seconds=1.0)
    assert state[1] > 0
    assert state[HEADING] > 0


def test_the_wheels_turn_no_faster_and_no_farther_than_they_can() -> None:
    angles = [state[STEERING] for state in driven(*[(0.0, 3.0)] * 20)]
    assert max(np.diff(angles)) <= CAR.max_steering_rate * TICK_S + 1e-9
    assert angles[-1] == pytest.approx(CAR.max_steering, abs=1e-3)
    assert max(angles) <= CAR.max_steering


def test_too_fast_for_the_bend_it_runs_wide() -> None:
    slow, fast = (driven(*[(CAR.resistance(v), 0.3)] * 20, speed=v)[-1] for v in (4.0, 25.0))
    wanted = math.tan(0.3) / CAR.wheelbase
    assert slow[YAW_RATE] / slow[SPEED] == pytest.approx(wanted, rel=0.01)
    assert fast[YAW_RATE] / fast[SPEED] < 0.2 * wanted
    assert fast[YAW_RATE] * fast[SPEED] == pytest.approx(CAR.friction * GRAVITY, rel=0.01)


def test_braking_in_a_bend_leaves_less_grip_for_the_bend() -> None:
    coasting, braking = (driven(*[(drive, 0.3)] * 5, speed=20.0)[-1] for drive in (0.0, -7.0))
    assert abs(braking[YAW_RATE] * braking[SPEED]) < 0.8 * abs(coasting[YAW_RATE] * coasting[SPEED])


@given(commands, speeds)
def test_speed_is_never_negative_and_states_stay_finite(commands: list[tuple[float, float]], speed: float) -> None:
    for state in driven(*commands, speed=speed):
        assert np.isfinite(state).all()
        assert state[SPEED] >= 0.0
        assert -math.pi <= state[HEADING] < math.pi


@given(commands, speeds, st.floats(0.2, 1.1))
def test_the_tyres_never_leave_the_friction_circle(
    commands: list[tuple[float, float]], speed: float, friction: float
) -> None:
    parameters = VehicleParameters(friction=friction)
    grip = friction * GRAVITY
    for state in driven(*commands, parameters=parameters, speed=speed)[1:]:
        longitudinal = min(max(state[DRIVE], -grip), grip)
        lateral = state[YAW_RATE] * state[SPEED]
        # A fifth of the grip is left for steering even where the brakes take all of it.
        assert math.hypot(longitudinal, lateral) <= grip * math.hypot(1.0, 0.2) + 1e-9
        if abs(longitudinal) < 0.97 * grip:
            assert math.hypot(longitudinal, lateral) <= grip + 1e-9


@given(commands, speeds)
def test_the_path_is_as_long_as_the_speed_says(commands: list[tuple[float, float]], speed: float) -> None:
    states = driven(*commands, speed=speed)
    for before, after in pairwise(states):
        moved = math.hypot(*(after[:2] - before[:2]))
        assert moved <= max(before[SPEED], after[SPEED], before[SPEED] + 4.5 * TICK_S) * TICK_S + 1e-9


def test_finer_substeps_hardly_change_the_path() -> None:
    weave = [(2.0, 0.15), (1.0, -0.2), (-3.0, 0.1), (0.5, 0.25)] * 3

    def end(substep: float) -> FloatArray:
        states = np.zeros((1, 8))
        states[0, SPEED] = 8.0
        constants = car_constants(CAR)
        for command in weave:
            advance(states, np.array([command]), round(0.5 / substep), substep, constants)
        return states[0, :2].copy()

    exact = end(0.0001)
    coarse, fine = (float(np.hypot(*(end(substep) - exact))) for substep in (0.01, 0.001))
    assert coarse < 0.5
    assert fine < 0.2 * coarse


@given(st.lists(commands, min_size=2, max_size=4), speeds)
def test_a_car_drives_the_same_alone_and_among_others(fleets: list[list[tuple[float, float]]], speed: float) -> None:
    length = min(map(len, fleets))
    together = Vehicles(CAR, len(fleets))
    together.states[:, SPEED] = speed
    for tick in range(length):
        together.advance(np.array([commands[tick] for commands in fleets]), TICK_S)
    for row, commands in enumerate(fleets):
        alone = Vehicles(CAR, 1)
        alone.states[:, SPEED] = speed
        for command in commands[:length]:
            alone.advance(np.array([command]), TICK_S)
        np.testing.assert_array_equal(together.states[row], alone.states[0])


def test_where_it_is_and_heads_changes_nothing_about_how_it_drives() -> None:
    here, there = Vehicles(CAR, 1), Vehicles(CAR, 1)
    here.place(0, 0.0, 0.0, 0.0)
    there.place(0, 1000.0, -500.0, 2.0)
    for vehicles in (here, there):
        for command in [(3.0, 0.2), (3.0, -0.3), (-5.0, 0.1)] * 5:
            vehicles.advance(np.array([command]), 0.3)
    cos, sin = math.cos(2.0), math.sin(2.0)
    turned = here.centres()[0] @ np.array([[cos, sin], [-sin, cos]]) + (1000.0, -500.0)
    np.testing.assert_allclose(there.centres()[0], turned, atol=1e-6)
    assert there.states[0, SPEED] == here.states[0, SPEED]
