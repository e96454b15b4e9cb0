from __future__ import annotations

import pytest

from dohyo.service.worlds.live.clock import Clock


def test_a_tick_in_real_time_begins_when_its_time_has_come() -> None:
    clock = Clock("realtime", 2.0)
    assert clock.wait_s(100.0) == 0.0
    clock.begin(100.0)
    assert clock.wait_s(100.01) == pytest.approx(0.04)
    clock.begin(100.06)
    assert clock.wait_s(100.06) == pytest.approx(0.04), "a little late: the next one is on time again"
    clock.change("realtime", 10.0)
    clock.begin(100.07)
    assert clock.wait_s(100.07) == pytest.approx(0.01)
    assert clock.overruns == 0


def test_a_world_that_is_too_slow_counts_it_and_does_not_catch_up() -> None:
    clock = Clock("realtime", 1.0)
    clock.begin(0.0)
    clock.begin(0.5)
    assert (clock.overruns, clock.wait_s(0.5)) == (1, pytest.approx(0.1))
    clock.restart()
    clock.begin(60.0)
    assert clock.overruns == 1, "it stood still"


def test_lockstep_knows_no_time() -> None:
    clock = Clock("lockstep", 1.0)
    clock.begin(0.0)
    clock.begin(9.0)
    assert (clock.wait_s(9.0), clock.overruns) == (0.0, 0)
