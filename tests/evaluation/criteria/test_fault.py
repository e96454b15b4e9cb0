"""Fault: a pure function of two boxes and their speeds; where the ego's lanes come in, a hand-made road."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.evaluation.criteria.fault import BEHIND_RAD, STOPPED_MPS, is_at_fault, keeps_to_one_lane
from dohyo.sumo_networks.scenario import Mission, Place
from dohyo.sumo_networks.units import TICK_S
from tests.worlds import LANE_M, Scene, lit_crossing, straight_road

EGO = (0.0, 0.0, 0.0, 4.5, 1.8)
AHEAD, BEHIND, BESIDE = (4.4, 0.0, 0.0, 4.5, 1.8), (-4.4, 0.0, 0.0, 4.5, 1.8), (-1.0, 1.7, 0.0, 4.5, 1.8)


def fault(other: tuple[float, ...], *, speed: float = 10.0, other_speed: float = 5.0, in_one_lane: bool = True) -> bool:
    return is_at_fault(np.array(EGO), speed, np.array(other), other_speed, tick_s=TICK_S, in_one_lane=in_one_lane)


@pytest.mark.parametrize("other", [AHEAD, BEHIND, BESIDE])
def test_a_stopped_ego_is_never_at_fault(other: tuple[float, ...]) -> None:
    assert not fault(other, speed=STOPPED_MPS, other_speed=0.0, in_one_lane=False)


@pytest.mark.parametrize("other", [AHEAD, BEHIND, BESIDE])
def test_an_ego_that_meets_something_stopped_always_is(other: tuple[float, ...]) -> None:
    assert fault(other, other_speed=STOPPED_MPS)


def test_the_front_bumper_is_the_egos_and_the_rear_one_the_others() -> None:
    assert fault(AHEAD)
    assert not fault(BEHIND, other_speed=15.0, in_one_lane=False)


@pytest.mark.parametrize("in_one_lane", [True, False])
def test_beside_the_lane_decides(in_one_lane: bool) -> None:
    assert fault(BESIDE, in_one_lane=in_one_lane) is not in_one_lane


def test_the_bumper_is_swept_over_the_tick() -> None:
    # A person 0.6 m behind the bumper: at 10 m/s the front met him within the tick, at 4 m/s he walked into the side.
    person = (2.25 - 0.6, 1.0, -math.pi / 2, 0.3, 0.5)
    assert fault(person, speed=10.0, other_speed=1.0)
    assert not fault(person, speed=2.0, other_speed=1.0)


@given(st.floats(-math.pi, math.pi), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.booleans())
def test_it_does_not_depend_on_place_or_direction(turn: float, x: float, y: float, in_one_lane: bool) -> None:
    cos, sin = math.cos(turn), math.sin(turn)
    for other in (AHEAD, BEHIND, BESIDE):
        moved = [x + cos * other[0] - sin * other[1], y + sin * other[0] + cos * other[1], turn + other[2], *other[3:]]
        there = is_at_fault(
            np.array([x, y, turn, *EGO[3:]]), 10.0, np.array(moved), 5.0, tick_s=TICK_S, in_one_lane=in_one_lane
        )
        assert there == fault(other, in_one_lane=in_one_lane)


def test_behind_begins_at_150_degrees() -> None:
    def at(degrees: float) -> tuple[float, ...]:
        angle = math.radians(degrees)
        return 2.0 * math.cos(angle), 2.0 * math.sin(angle), 0.0, 1.0, 1.0

    assert math.degrees(BEHIND_RAD) == pytest.approx(150.0)
    assert fault(at(149.0), in_one_lane=False)
    assert not fault(at(151.0), in_one_lane=False)


def in_one_lane(scene: Scene) -> bool:
    world = scene.world()
    return keeps_to_one_lane(world.network, world.egos.box(0), int(world.egos.lane[0]))


@pytest.mark.parametrize("heading", [-0.5, 0.5])
def test_an_ego_that_comes_from_another_lane_or_goes_to_one_is_in_two(heading: float) -> None:
    changing = straight_road().with_ego(x=50, left=0.5, heading=heading)
    assert not in_one_lane(changing)


@pytest.mark.parametrize(("beyond", "kept"), [(-0.1, True), (0.08, True), (0.12, False), (0.45, False)])
def test_an_ego_with_a_corner_beside_the_road_keeps_to_no_lane(beyond: float, kept: bool) -> None:
    assert in_one_lane(straight_road().with_ego(x=50, left=-(LANE_M / 2 - 0.9 + beyond))) is kept


@pytest.mark.parametrize("x", [-14.0, -10.4, -5.0, 0.0, 5.0, 10.4, 14.0])
def test_a_lane_through_a_junction_is_one_lane(x: float) -> None:
    in_lane, straddling = lit_crossing().with_ego(x=x), lit_crossing().with_ego(x=x, left=LANE_M / 2)
    assert in_one_lane(in_lane)
    assert not in_one_lane(straddling)


@pytest.mark.parametrize(("start", "goal"), [("w_c_0", "c_s_0"), ("w_c_0", "c_e_0"), ("w_c_1", "c_n_1")])
def test_an_ego_that_follows_a_turn_keeps_to_one_lane(start: str, goal: str) -> None:
    mission = Mission(start=Place(lane=start), goal=Place(lane=goal, position_m=-1.0))
    scene = dataclasses.replace(lit_crossing(), mission=mission)
    route = scene.route
    for i in range(route.index(180.0), route.index(225.0)):
        x, y = route.position[i]
        assert in_one_lane(scene.with_ego(x=x, y=y, heading=float(route.heading[i]))), (x, y)
