"""Reeds-Shepp and Dubins curves: ends, symmetry, and comparison with other curves."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dohyo.agents.parking.expert.curves import advanced, poses_along, wrapped
from dohyo.agents.parking.expert.shortest import shortest_curve

RADIUS = 1.3
COORDINATE = st.floats(-6.0, 6.0)
POSE = st.tuples(COORDINATE, COORDINATE, st.floats(-math.pi, math.pi)).map(np.array)


@pytest.mark.parametrize("reverse", [False, True])
@settings(max_examples=200, deadline=None)
@given(start=POSE, goal=POSE)
def test_a_curve_ends_at_its_goal_and_is_no_shorter_than_the_straight_line(reverse, start, goal):
    length, curve = shortest_curve(start, goal, RADIUS, reverse)
    end = poses_along(start, curve, RADIUS, step=0.1)[-1]
    assert np.abs(end[:2] - goal[:2]).max() < 1e-6
    assert abs(wrapped(end[2] - goal[2])) < 1e-6
    assert length == pytest.approx(RADIUS * np.abs(curve[:, 1]).sum())
    assert length >= math.dist(start[:2], goal[:2]) - 1e-9


@settings(max_examples=200, deadline=None)
@given(start=POSE, goal=POSE)
def test_reverse_makes_a_way_as_long_as_its_way_back_and_never_longer(start, goal):
    length, _ = shortest_curve(start, goal, RADIUS, reverse=True)
    assert length == pytest.approx(shortest_curve(goal, start, RADIUS, reverse=True)[0], abs=1e-6)
    assert length <= shortest_curve(start, goal, RADIUS, reverse=False)[0] + 1e-9


@settings(max_examples=100, deadline=None)
@given(start=POSE, goal=POSE)
def test_a_forward_curve_never_goes_back(start, goal):
    assert (shortest_curve(start, goal, RADIUS, reverse=False)[1][:, 1] >= 0.0).all()


def test_no_curve_of_up_to_four_segments_on_a_grid_is_shorter():
    lengths = [sign * length for length in (0.4, 1.1, 1.9) for sign in (1.0, -1.0)]
    segments = list(product((-1.0, 0.0, 1.0), lengths))
    generator = np.random.default_rng(0)
    for _ in range(3000):
        drawn = [segments[i] for i in generator.integers(len(segments), size=4)]
        x = y = heading = 0.0
        for steering, length in drawn:
            x, y, heading = advanced(x, y, heading, steering, length)
        goal = np.array([x, y, heading])
        shortest = shortest_curve(np.zeros(3), goal, 1.0, reverse=True)[0]
        assert shortest <= sum(abs(length) for _, length in drawn) + 1e-6


def test_known_curves():
    def length(*goal: float, reverse: bool) -> float:
        return shortest_curve(np.zeros(3), np.array(goal), 1.0, reverse)[0]

    assert length(-3.0, 0.0, 0.0, reverse=True) == pytest.approx(3.0)
    assert length(0.0, 2.0, math.pi, reverse=False) == pytest.approx(math.pi)
    # Three quarter turns change the heading by a right angle on the spot; forwards alone it takes more.
    assert length(0.0, 0.0, math.pi / 2, reverse=True) < math.pi
