from __future__ import annotations

import numpy as np

from dohyo.agents.speed_planning.bottleneck import BottleneckWatch, heads


def test_congestion_ends_where_speed_rises_again() -> None:
    speed = np.array([30, 30, 8, 8, 28, 30, 9, 30.0])
    assert heads(speed, 30.0, 100.0).tolist() == [400.0, 700.0]
    assert heads(speed, 30.0, 100.0, shift_m=50.0).tolist() == [450.0, 750.0]
    assert heads(np.full(5, 30.0), 30.0, 100.0).tolist() == []


def test_what_stays_is_a_standing_bottleneck_from_the_fourth_publication() -> None:
    watch = BottleneckWatch()
    found = [watch.update(np.array([8700.0 + shift])) for shift in (0, 100, -100, 0)]
    assert found[:3] == [None, None, None]
    assert found[3] == 8700.0


def test_a_jam_that_travels_upstream_is_not_one() -> None:
    watch = BottleneckWatch()
    jam = 9000.0 - 4.2 * 60 * np.arange(12)
    assert all(watch.update(np.array([where])) is None for where in jam)


def test_a_moving_jam_upstream_does_not_hide_the_standing_bottleneck() -> None:
    watch = BottleneckWatch()
    found = [watch.update(np.array([6000.0 - 252 * k, 8700.0])) for k in range(6)]
    assert found[-1] == 8700.0


def test_it_is_kept_for_a_while_and_then_let_go() -> None:
    watch = BottleneckWatch(hold=2)
    for _ in range(5):
        watch.update(np.array([8700.0]))
    after = [watch.update(np.empty(0)) for _ in range(3)]
    assert after == [8700.0, 8700.0, None]
