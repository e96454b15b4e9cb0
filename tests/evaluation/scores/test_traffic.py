from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.evaluation.scores.traffic import OutcomeWatch, PassageCount
from dohyo.sumo_networks.freeway.road import load_freeway
from tests.sumo_networks.freeway.worlds import world_of

AT = load_freeway().bottleneck_m


def test_the_outcome_of_a_hand_made_second() -> None:
    watch = OutcomeWatch()
    watch.observe(world_of(100.0, [AT - 50, AT - 10], [10.0, 20.0]))
    watch.observe(world_of(101.0, [AT - 40, AT + 10], [10.0, 20.0]))
    found = watch.outcome()
    assert found.throughput_vph == pytest.approx(1800)  # one in two seconds
    assert found.speed_mps == pytest.approx(15.0)
    assert found.speed_std_mps == pytest.approx(5.0)
    assert found.travelled_km == pytest.approx(0.06)
    assert found.fuel_sumo_g_km == pytest.approx(4.0 / 0.06)
    assert found.least_headway_s == pytest.approx(3.5)
    assert found.least_ttc_s == np.inf


def test_closing_in_shows_in_time_to_collision() -> None:
    watch = OutcomeWatch()
    watch.observe(world_of(100.0, [1000.0, 1020.0], [20.0, 10.0]))
    found = watch.outcome()
    assert found.least_ttc_s == pytest.approx(1.5)
    assert found.close_share == pytest.approx(0.5)
    assert found.collisions == 0


def test_vehicles_inside_one_another_are_a_collision_counted_once() -> None:
    watch = OutcomeWatch()
    for time_s in (100.0, 101.0):
        watch.observe(world_of(time_s, [1000.0, 1004.0], [20.0, 20.0]))
    assert watch.outcome().collisions == 1


def test_spread_within_a_minute_leaves_out_what_changes_from_minute_to_minute() -> None:
    watch = OutcomeWatch()
    watch.observe(world_of(60.0, [1000.0, 2000.0], [20.0, 20.0]))
    watch.observe(world_of(120.0, [1000.0, 2000.0], [10.0, 10.0]))
    assert watch.outcome().speed_std_within_mps == pytest.approx(0.0)
    assert watch.outcome().speed_std_mps == pytest.approx(5.0)


def test_nobody_passes_twice_nor_by_going_backwards() -> None:
    count = PassageCount()
    passed = [count.observe(world_of(float(k), [AT + away], [20.0])) for k, away in enumerate((-30, -10, 10, 30, -5))]
    assert passed == [0, 0, 1, 0, 0]


@given(st.lists(st.floats(0.0, 40.0), min_size=1, max_size=30))
def test_the_spread_is_numpys(speeds: list[float]) -> None:
    watch = OutcomeWatch()
    watch.observe(world_of(100.0, [1000.0 + 100 * k for k in range(len(speeds))], speeds))
    assert watch.outcome().speed_std_mps == pytest.approx(float(np.std(speeds)), abs=1e-5)
