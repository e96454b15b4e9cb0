from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.agents.speed_planning.acc import EMERGENCY, stock_acc
from dohyo.agents.speed_planning.follower_stopper import LaneChangeRecovery, envelope, follower_stopper, safe_speed

LENGTH_M = 5.0


def command(target: float, gap: float, leader: float, own: float, ease: float = 1.0) -> float:
    return float(follower_stopper(*(np.array([value]) for value in (target, gap, leader, own, ease)))[0])


@pytest.mark.parametrize(
    ("gap", "expected"),
    [
        (4.0, 0.0),  # nearer than 4.5 m
        (4.875, 5.0),  # halfway from 4.5 to 5.25 m: half the leader's 10 m/s
        (5.25, 10.0),
        (5.625, 15.0),  # halfway from 5.25 to 6 m: between the leader's speed and the target
        (6.5, 20.0),
        (np.inf, 20.0),
    ],
)
def test_the_published_cases_at_equal_speeds(gap: float, expected: float) -> None:
    assert command(target=20.0, gap=gap, leader=10.0, own=10.0) == pytest.approx(expected)


def test_closing_in_widens_the_envelopes() -> None:
    """At 4 m/s closing: dx = 4.5 + 16/3, 5.25 + 16/2, 6 + 16/1."""
    assert float(envelope(np.array([9.0]), np.array([10.0]), np.array([14.0]))[0]) == pytest.approx(22.0)
    assert command(20.0, 9.8, 10.0, 14.0) == 0.0
    assert command(20.0, 13.25, 10.0, 14.0) == pytest.approx(10.0)
    assert command(20.0, 22.1, 10.0, 14.0) == 20.0


@given(
    target=st.floats(0, 40),
    gap=st.floats(0, 200),
    leader=st.floats(0, 40),
    own=st.floats(0, 40),
    ease=st.floats(0.3, 1),
)
def test_the_command_is_between_standing_and_the_target(
    target: float, gap: float, leader: float, own: float, ease: float
) -> None:
    assert 0.0 <= command(target, gap, leader, own, ease) <= target


def test_a_cut_in_is_met_gently_and_forgotten() -> None:
    recovery = LaneChangeRecovery()
    recovery.ease("far", 40.0, 6.0, 0.5)
    eased = recovery.ease("cutter", 4.0, 6.0, 0.5)
    assert eased == pytest.approx(4 / 6)
    assert recovery.softened(0.0, own=15.0, gap_m=8.0, leader_mps=15.0, step_s=0.5) == pytest.approx(15 - 1.5 * 0.5)
    grown = [recovery.ease("cutter", 8.0, 6.0, 0.5) for _ in range(20)]
    assert grown == sorted(grown)
    assert grown[-1] == 1.0
    assert recovery.softened(0.0, own=15.0, gap_m=8.0, leader_mps=15.0, step_s=0.5) == 0.0


def test_danger_is_never_softened() -> None:
    recovery = LaneChangeRecovery()
    recovery.ease("cutter", 4.0, 20.0, 0.5)
    assert recovery.softened(0.0, own=20.0, gap_m=10.0, leader_mps=5.0, step_s=0.5) == 0.0


def test_a_cut_out_does_not_make_it_jump_ahead() -> None:
    recovery = LaneChangeRecovery()
    recovery.ease("slow", 10.0, 6.0, 0.5)
    recovery.ease(None, float("inf"), 6.0, 0.5)
    assert recovery.softened(30.0, own=10.0, gap_m=float("inf"), leader_mps=float("inf"), step_s=0.5) == pytest.approx(
        10.5
    )


@given(
    targets=st.lists(st.floats(0, 40), min_size=80, max_size=80),
    wishes=st.lists(st.floats(-4, 2), min_size=80, max_size=80),
    leader=st.floats(0, 35),
    headway=st.floats(1.0, 4.0),
)
def test_whatever_the_plan_the_safe_speed_never_runs_into_a_leader(
    targets: list[float], wishes: list[float], leader: float, headway: float
) -> None:
    own, gap = leader, 4.0 + headway * leader
    for target, wish in zip(targets, wishes, strict=True):
        safe = float(safe_speed(np.array([gap]), np.array([leader]), delay_s=0.5)[0])
        told = min(command(target, gap, leader, own), safe)
        after = np.clip(told, own - 8.0 * 0.5, own + 2.0 * 0.5)
        ahead = max(leader + wish * 0.5, 0.0)
        gap += 0.5 * (ahead + leader) / 2 - 0.5 * (own + after) / 2
        own, leader = float(max(after, 0.0)), ahead
        assert gap > 0


@given(
    settings=st.lists(st.tuples(st.integers(20, 80), st.sampled_from([1.2, 1.6, 2.2])), min_size=60, max_size=60),
    wishes=st.lists(st.floats(-8, 2), min_size=60, max_size=60),
    leader=st.floats(0, 35),
)
def test_whatever_is_set_the_cruise_control_does_not_crash(
    settings: list[tuple[int, float]], wishes: list[float], leader: float
) -> None:
    """A leader brakes as hard as cars can; the gap is the smallest that the cruise control would itself keep."""
    own, gap = leader, 3.0 + 1.2 * leader
    for (mph, time_gap), wish in zip(settings, wishes, strict=True):
        for _ in range(10):
            acceleration = stock_acc(own, gap, leader, mph * 0.44704, time_gap)
            assert EMERGENCY <= acceleration <= 1.5
            ahead, after = max(leader + wish * 0.1, 0.0), max(own + acceleration * 0.1, 0.0)
            gap += 0.1 * (ahead + leader) / 2 - 0.1 * (own + after) / 2
            own, leader = after, ahead
            assert gap > 0
