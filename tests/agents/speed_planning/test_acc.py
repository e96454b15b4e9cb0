from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.speed_planning.acc import MPH, Memory, SetPointPolicy, Settings, settings_of, stock_acc
from dohyo.agents.speed_planning.training.platoon import idm


@pytest.mark.parametrize(
    ("action", "mph"),
    [(-1.0, 20), (0.0, 45), (0.3, 58), (1.0, 80)],  # int((a + 1) 20) m/s: 0, 20, 26, 40
)
def test_speeds_are_whole_mph_the_car_can_be_set_to(action: float, mph: int) -> None:
    assert settings_of(np.array([[action, 0.0]])).speed[0] / MPH == pytest.approx(mph)


def test_gaps_by_thirds() -> None:
    actions = np.array([[0.0, -0.4], [0.0, 0.0], [0.0, 0.4]])
    assert settings_of(actions).gap.tolist() == [0.0, 1.0, 2.0]


def test_34_observations_with_what_they_mean_in_their_place() -> None:
    memory = Memory.of(np.array([20.0]))
    memory.remember(np.array([1.0]), np.array([21.0]), Settings(np.array([24.0]), np.array([2.0])))
    seen = memory.observation(np.array([21.0]), np.array([79.0]), np.array([[10.0, 20, 30, 40]]), np.array([True]))[0]
    assert len(seen) == 34
    assert seen[0] == pytest.approx(21 / 40)
    assert seen[1:6] == pytest.approx([0.25, 0, 0, 0, 0])
    assert seen[6] == 1.0
    assert seen[7:11] == pytest.approx([0.25, 0.5, 0.75, 1.0])
    assert seen[11:14] == pytest.approx([1.0, 24 / 40, 1.0])
    assert seen[14:18] == pytest.approx([21 / 40, 24 / 40, 20 / 40, 20 / 40])


def test_a_leader_beyond_80_m_is_not_seen() -> None:
    memory = Memory.of(np.array([20.0]))
    far = memory.observation(np.array([20.0]), np.array([81.0]), np.zeros((1, 4)), np.array([False]))
    assert far[0, 6] == 0.0


def test_cruise_control_settles_at_its_speed_or_its_gap() -> None:
    speed, gap = 20.0, 60.0
    for _ in range(3000):
        acceleration = stock_acc(speed, gap, 15.0, 30.0, 1.6)
        gap += (15.0 - speed) * 0.1
        speed += acceleration * 0.1
    assert speed == pytest.approx(15.0, abs=0.05)
    assert gap == pytest.approx(3.0 + 1.6 * 15.0, abs=0.5)
    assert stock_acc(30.0, np.inf, 0.0, 30.0, 1.6) == pytest.approx(0.0)


def test_a_human_driver_keeps_speed_alone_and_brakes_when_near() -> None:
    assert idm(33.0, 1e6, 33.0) == pytest.approx(0.0, abs=1e-3)
    assert idm(20.0, 10.0, 10.0) < -4.0


def test_the_shipped_policy_sets_what_the_car_takes() -> None:
    settings = SetPointPolicy.shipped().settings(np.random.default_rng(0).uniform(0, 1, (50, 34)))
    mph = settings.speed / MPH
    assert mph == pytest.approx(np.round(mph))
    assert (mph >= 19.99).all()
    assert (mph <= 80.01).all()
