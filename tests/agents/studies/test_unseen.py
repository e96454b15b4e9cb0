"""The gap of generalisation: the difference of two shares, and how much larger it is than another driver's."""

from __future__ import annotations

import pytest

from dohyo.agents.studies.unseen import gap, gap_beyond, place_of


def test_a_cell_tells_what_the_training_saw() -> None:
    assert place_of("town-train.dense.test.m05") == (True, False)
    assert place_of("town-test.empty.train") == (False, True)


def test_the_difference_has_an_interval_that_knows_both_sides() -> None:
    found = gap([True] * 90 + [False] * 10, [True] * 60 + [False] * 40)
    assert found.mean is not None
    assert round(found.mean, 6) == 30.0
    assert found.low is not None
    assert found.high is not None
    assert 15.0 < found.low < 25.0 < 35.0 < found.high < 45.0


def test_few_drives_leave_room_for_a_gap_though_all_succeed() -> None:
    """Wilson's bound of 5 of 5 is 56.55 %; Newcombe's interval has that of one side at each end."""
    few = gap([True] * 5, [True] * 5)
    assert few.mean == 0.0
    assert few.low == pytest.approx(-43.45, abs=0.01)
    assert few.high == pytest.approx(43.45, abs=0.01)


def test_its_interval_is_that_of_its_source() -> None:
    """Newcombe 1998, table II (a): 56 of 70 and 48 of 80."""
    found = gap([True] * 56 + [False] * 14, [True] * 48 + [False] * 32)
    assert (found.mean, found.low, found.high) == pytest.approx((20.0, 5.24, 33.39), abs=0.01)


def test_what_the_towns_themselves_cost_is_no_gap_of_the_driver() -> None:
    harder = gap_beyond([(True, True)] * 20, [(False, False)] * 12)
    assert (harder.mean, harder.low, harder.high) == (0.0, 0.0, 0.0)
    lost = gap_beyond([(True, True)] * 30, [(False, True)] * 15 + [(True, True)] * 15)
    assert lost.mean == 50.0
    assert lost.low is not None
    assert lost.high is not None
    assert 25.0 < lost.low < 40.0 < 60.0 < lost.high < 75.0
