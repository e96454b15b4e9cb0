"""What follows an emergency brake."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.mcts.mbappe import Mbappe
from tests.agents.mcts.roads import observation


def test_the_brakes_are_let_go_once_the_danger_is_over() -> None:
    planner = Mbappe(predictor="constant_velocity", simulations=64)
    assert planner.act(observation([(11.0, 0.0, 0.0)], speed=9.0))[0] == pytest.approx(-8.0)
    after = observation(speed=8.2)
    after["ego_state"][4] = -8.0
    demands = np.array([float(planner.act(after)[0]) for _ in range(14)])
    changes = np.diff(demands, prepend=-8.0)
    hard = np.concatenate([[-8.0], demands])[:-1] < -3.0
    np.testing.assert_allclose(changes[hard][:-1], 1.0)
    assert (changes[~hard] <= 0.35 + 1e-9).all()
    assert demands[-1] > 0.0  # at the bounded jerk alone it would still be braking by 3 m/s^2
