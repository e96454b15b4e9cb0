"""Rewards of the sub-policies, worked out by hand."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.agents.hierarchical.environments.pace import Pace
from dohyo.agents.hierarchical.environments.rewards import (
    INFRACTION,
    Terms,
    angle_term,
    deviation_term,
    reward,
    speed_term,
    terms,
)

TEN = Pace(least=8.0, target=10.0, most=12.0)
STAND = Pace(least=0.0, target=0.0, most=2.0)
SHARES = st.floats(0.0, 1.0)


@pytest.mark.parametrize(
    ("speed", "expected"), [(0.0, 0.0), (4.0, 0.5), (8.0, 1.0), (9.9, 1.0), (10.0, 1.0), (11.0, 0.5), (12.0, 0.0)]
)
def test_speed_rises_to_the_least_and_falls_from_the_target(speed, expected):
    assert speed_term(speed, TEN) == pytest.approx(expected)


def test_beyond_the_most_the_term_is_0_and_does_not_turn_positive_when_squared():
    assert speed_term(20.0, TEN) == 0.0


@pytest.mark.parametrize(("speed", "expected"), [(0.0, 1.0), (1.0, 0.5), (2.0, 0.0)])
def test_where_the_ego_must_stand_it_is_paid_for_standing(speed, expected):
    assert speed_term(speed, STAND) == pytest.approx(expected)


@pytest.mark.parametrize(("metres", "expected"), [(0.0, 1.0), (-1.5, 0.5), (3.0, 0.0), (7.0, 0.0)])
def test_deviation_falls_to_0_at_3_m(metres, expected):
    assert deviation_term(metres) == pytest.approx(expected)


@pytest.mark.parametrize(("degrees", "expected"), [(0.0, 1.0), (-45.0, 0.5), (90.0, 0.0), (170.0, 0.0)])
def test_angle_falls_to_0_at_90_degrees(degrees, expected):
    assert angle_term(math.radians(degrees)) == pytest.approx(expected)


def test_a_moment_by_hand():
    # 11 of 10 to 12 m/s; 0.6 of 3 m; 9 of 90 degrees: (0.5 * 0.8 * 0.9)^2.
    found = terms(11.0, TEN, deviation=-0.6, angle=math.radians(9.0))
    assert reward(found, infraction=False) == pytest.approx(0.36**2)
    assert reward(found, infraction=False, form="sum") == pytest.approx((0.25 + 0.64 + 0.81) / 3.0)


@given(SHARES, SHARES, SHARES, st.sampled_from(["product", "sum"]))
def test_an_infraction_is_worth_minus_10_whatever_else_is_true(speed, deviation, angle, form):
    found = Terms(speed, deviation, angle)
    assert reward(found, infraction=True, form=form) == INFRACTION == -10.0
    assert 0.0 <= reward(found, infraction=False, form=form) <= 1.0


@given(SHARES, SHARES)
def test_in_the_product_one_0_is_enough_and_in_the_sum_it_is_not(deviation, angle):
    found = Terms(0.0, deviation, angle)
    assert reward(found, infraction=False) == 0.0
    assert reward(found, infraction=False, form="sum") == pytest.approx((deviation**2 + angle**2) / 3.0)
