"""SUMO's frame: degrees clockwise from north, and the front bumper."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.sumo_networks.simulation.sumo_frame import ahead_of, angle_of, heading_of

METRES = st.floats(-1e4, 1e4)


@pytest.mark.parametrize(
    ("angle", "heading"), [(90.0, 0.0), (0.0, math.pi / 2), (270.0, -math.pi), (180.0, -math.pi / 2)]
)
def test_east_north_west_and_south(angle: float, heading: float) -> None:
    assert heading_of(angle) == pytest.approx(heading)


@given(st.floats(0.0, 360.0))
def test_an_angle_survives_the_way_there_and_back(angle: float) -> None:
    assert math.remainder(angle_of(heading_of(angle)) - angle, 360.0) == pytest.approx(0.0, abs=1e-9)


@given(METRES, METRES, st.floats(-math.pi, math.pi), st.floats(0.0, 20.0))
def test_the_centre_is_behind_the_front_and_the_front_ahead_of_the_centre(
    x: float, y: float, heading: float, half: float
) -> None:
    front = ahead_of(x, y, heading, half)
    assert math.dist(front, (x, y)) == pytest.approx(half, abs=1e-8)
    assert ahead_of(*front, heading, -half) == pytest.approx((x, y), abs=1e-8)
