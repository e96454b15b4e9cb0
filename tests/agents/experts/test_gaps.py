"""Gaps in the oncoming lane: who is past, who comes too soon, and who is relied on to brake."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.agents.experts.gaps import leaves_room

LENGTH_M = 4.6
HALF_M = 2.25


def room(front: float, pace: float = 12.0, *, braking: float = 0.0, margin: float = 1.0, speed: float = 0.0) -> bool:
    """Whether a car that comes leaves room to go round another one that is parked 8 m ahead."""
    enter, leave = 4.0, 22.0
    return leaves_room(
        front, front + LENGTH_M, pace, enter, leave, 10.0, speed, HALF_M, braking, margin, blocker_speed=0.0
    )


def test_who_is_far_away_leaves_room_and_who_is_near_does_not() -> None:
    assert room(120.0)
    assert not room(50.0)


def test_who_has_passed_before_the_ego_turns_out_leaves_room() -> None:
    # The ego needs 1.8 s to its 4 m, in which 12 m/s bring the other's rear from 15 m to beside it.
    assert room(10.0)
    assert not room(10.0, pace=3.0)


def test_who_stands_in_the_lane_never_leaves_room() -> None:
    assert not room(15.0, pace=0.0, braking=4.5)


def test_relying_on_brakes_makes_do_with_a_smaller_gap() -> None:
    needed = [next(d for d in range(40, 150) if room(float(d), braking=braking)) for braking in (0.0, 3.0, 4.5)]
    assert needed[0] > needed[1] > needed[2]
    assert needed[0] - needed[2] > 8


def test_nobody_is_relied_on_to_brake_before_he_sees_the_ego_in_his_lane() -> None:
    # Of two who come at the same pace, the one that the ego meets while it turns out has no time to brake.
    assert not room(28.0, braking=4.5)


@given(
    front=st.floats(-10.0, 150.0),
    pace=st.floats(0.0, 20.0),
    speed=st.floats(0.0, 10.0),
    braking=st.floats(0.0, 6.0),
    margin=st.floats(0.0, 5.0),
)
def test_more_margin_never_makes_room(front: float, pace: float, speed: float, braking: float, margin: float) -> None:
    if room(front, pace, braking=braking, margin=margin + 1.0, speed=speed):
        assert room(front, pace, braking=braking, margin=margin, speed=speed)


@given(front=st.floats(30.0, 150.0), pace=st.floats(1.0, 20.0), nearer=st.floats(0.0, 20.0))
def test_once_in_his_lane_nearer_is_never_better(front: float, pace: float, nearer: float) -> None:
    def out(front: float) -> bool:
        return leaves_room(front, front + LENGTH_M, pace, 0.0, 18.0, 10.0, 5.0, HALF_M, 4.5, 0.0, 0.0)

    if front - nearer > HALF_M and out(front - nearer):
        assert out(front)


@pytest.mark.parametrize("crawl", [0.0, 2.8])
def test_a_blocker_that_crawls_on_takes_more_room(crawl: float) -> None:
    needed = next(
        d for d in range(30, 200) if leaves_room(d, d + 4.6, 10.0, 4.0, 22.0, 10.0, 5.0, HALF_M, 0.0, 1.0, crawl)
    )
    assert (needed > 62) == (crawl > 0.0)
