"""Means over scenarios and trainings, and differences of two who drove the same."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.agents.studies import crossed_bootstrap
from dohyo.agents.studies.crossed_bootstrap import Matched, dense_estimate
from dohyo.evaluation.statistics import mean_estimate


def test_the_crossed_bootstrap_knows_how_far_trainings_and_scenarios_differ():
    scenarios = [float(100 * (i % 2)) for i in range(40)]
    same = {("b", f"m{i:02}", 0): dict.fromkeys(range(3), value) for i, value in enumerate(scenarios)}
    by_scenario = crossed_bootstrap.estimate(same, mean_estimate)
    over_means = mean_estimate(scenarios)
    # Three trainings that agree in every scenario are no more evidence than one.
    assert by_scenario.n == 120
    assert (by_scenario.low, by_scenario.high) == pytest.approx((over_means.low, over_means.high), abs=3.0)
    apart = {key: {0: 0.0, 1: 50.0, 2: 100.0} for key in same}
    by_training = crossed_bootstrap.estimate(apart, mean_estimate)
    # All three draws are the worst one in 1 of 27 cases.
    assert (by_training.mean, by_training.low, by_training.high) == pytest.approx((50.0, 0.0, 100.0))


@pytest.mark.parametrize(("trainings", "quantile"), [(2, 12.706205), (3, 4.302653), (10, 2.262157)])
def test_trainings_in_one_place_have_students_interval(trainings, quantile):
    values = [float(i * i) for i in range(trainings)]
    found = crossed_bootstrap.estimate({("early",): dict(enumerate(values))}, mean_estimate)
    half = quantile * np.std(values, ddof=1) / trainings**0.5
    assert (found.low, found.high) == pytest.approx((np.mean(values) - half, np.mean(values) + half))
    assert (found.mean, found.n) == (np.mean(values), trainings)


def test_a_mean_is_over_the_drives_that_are_there():
    holes = {("b", "m0", 0): {0: 100.0, 1: 0.0}, ("b", "m1", 0): {1: 0.0}, ("b", "m2", 0): {0: 100.0, 1: 100.0}}
    found = crossed_bootstrap.estimate(holes, mean_estimate)
    assert found.mean == pytest.approx(60.0)
    assert found.n == 5
    assert all(math.isfinite(end) for end in (found.low, found.high))
    table = np.array([[100.0, 0.0], [np.nan, 0.0], [100.0, 100.0]])
    assert np.isfinite(crossed_bootstrap._crossed(table, *crossed_bootstrap._counts(3, 2, 500))).all()


def test_common_values_are_those_of_the_scenarios_that_all_trainings_drove():
    assert crossed_bootstrap.common({("a",): {0: 3.0, 1: 5.0}, ("b",): {0: 1.0}}) == {("a",): {0: 3.0, 1: 5.0}}
    assert crossed_bootstrap.common({("a",): {None: 3.0}}) == {("a",): {None: 3.0}}
    assert crossed_bootstrap.common({}) == {}


def test_differences_are_of_what_both_drove_by_training_and_who_did_not_learn_meets_all():
    ours = {("a",): {0: 3.0, 1: 5.0}, ("b",): {0: 1.0}}
    theirs = {("a",): {1: 1.0, 2: 9.0}, ("c",): {0: 4.0}}
    assert crossed_bootstrap.difference(ours, theirs) == {("a",): {1: 4.0}}
    assert crossed_bootstrap.difference(ours, {("a",): {None: 1.0}}) == {("a",): {0: 2.0, 1: 4.0}}


def crossing(values: np.ndarray) -> Matched:
    """(seeds, scenarios) values."""
    return {(column,): dict(enumerate(values[:, column].tolist())) for column in range(values.shape[1])}


def test_an_interval_over_seeds_and_days_is_no_narrower_than_over_days_alone() -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(0, 1, 12) + rng.normal(0, 1.0, (3, 1))
    both, days = dense_estimate(crossing(values)), dense_estimate(crossing(values.mean(axis=0, keepdims=True)))
    assert both.mean == pytest.approx(values.mean())
    assert both.high - both.low > days.high - days.low
    flat = dense_estimate(crossing(np.full((3, 4), 2.0)))
    assert (flat.mean, flat.low, flat.high) == (2.0, 2.0, 2.0)


def test_a_missing_value_makes_no_mean_that_is_no_number() -> None:
    values = crossing(np.full((3, 4), 5.0))
    del values[2,][1]  # type: ignore[attr-defined]
    found = dense_estimate(values)
    assert (found.mean, found.n) == (5.0, 11)


@pytest.mark.parametrize("last", [100.0, 100.0001, 100.005])
def test_three_trainings_that_hardly_differ_are_no_certainty(last: float) -> None:
    assert crossed_bootstrap.p_value({("a",): {0: 100.0, 1: 100.0, 2: last}}) == 0.25
