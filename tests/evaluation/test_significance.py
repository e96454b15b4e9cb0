"""Tests of paired differences, against SciPy, by hand, and by what they promise where there is no difference."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest, permutation_test, ttest_1samp

from dohyo.evaluation.significance import EXACT, LEVEL, differ, random_effects, sign_flips


def table(rng: np.random.Generator, n: int, k: int, scenarios: float, trainings: float) -> np.ndarray:
    """(N, K) differences without an effect."""
    spread = rng.normal(0.0, scenarios, (n, 1)) + rng.normal(0.0, trainings, (1, k))
    return np.asarray(spread + rng.normal(0.0, 0.5, (n, k)))


@pytest.mark.parametrize("worse", [0, 1, 3])
def test_successes_are_judged_as_by_mcnemar(worse: int) -> None:
    differences = np.array([100.0] * 8 + [-100.0] * worse + [0.0] * 13)
    assert sign_flips(differences) == pytest.approx(binomtest(8, 8 + worse).pvalue)


def test_a_few_differences_are_tested_exactly_as_by_scipy() -> None:
    differences = np.random.default_rng(0).normal(0.5, 1.0, 14)
    theirs = permutation_test((differences,), np.mean, permutation_type="samples", n_resamples=np.inf)
    assert sign_flips(differences) == pytest.approx(theirs.pvalue)


def test_all_signs_of_thirty_differences_count_as_successes_do() -> None:
    differences = np.array([1.0] * 24 + [-1.0] * 6)
    assert sign_flips(differences) == pytest.approx(binomtest(24, 30).pvalue, rel=1e-12)
    uneven = differences * np.where(np.arange(30) < 3, 1.0 + 1e-12, 1.0)  # another sum for each choice of signs
    assert sign_flips(uneven) == pytest.approx(sign_flips(differences), rel=1e-12)


@pytest.mark.parametrize("count", [9, EXACT, EXACT + 20])
def test_the_order_of_the_differences_is_without_effect(count: int) -> None:
    rng = np.random.default_rng(5)
    differences = rng.normal(0.4, 1.0, count)
    assert len({sign_flips(rng.permutation(differences)) for _ in range(5)}) == 1


def test_many_differences_are_drawn_near_the_t_test() -> None:
    differences = np.random.default_rng(1).normal(0.3, 1.0, 60)
    assert sign_flips(differences) == pytest.approx(ttest_1samp(differences, 0.0).pvalue, abs=0.01)
    assert sign_flips(np.full(60, 1.0)) < 1e-4


def test_stronger_evidence_has_no_larger_p_value() -> None:
    values = [sign_flips(np.array([1.0] * (44 - against) + [-1.0] * against)) for against in range(12)]
    assert values == sorted(values)
    assert values[0] < 1e-5


@pytest.mark.parametrize("count", [0, 1, 4])
def test_four_scenarios_on_one_side_prove_nothing(count: int) -> None:
    assert sign_flips(np.array([3.0] * count + [0.0] * 9)) == (2.0 ** (1 - count) if count else 1.0)


def test_one_row_or_column_is_a_t_test() -> None:
    values = np.random.default_rng(2).normal(1.0, 1.0, 7)
    expected = ttest_1samp(values, 0.0).pvalue
    assert random_effects(values[None, :]) == pytest.approx(expected)
    assert random_effects(values[:, None]) == pytest.approx(expected)


def test_without_a_spread_there_is_nothing_to_doubt() -> None:
    assert random_effects(np.full((5, 3), 2.0)) == 0.0
    assert random_effects(np.zeros((5, 3))) == 1.0


def test_trainings_that_differ_count_more_than_scenarios() -> None:
    rows = np.random.default_rng(3).normal(0.0, 0.1, (40, 1))
    alike, apart = rows + np.array([5.0, 5.1, 4.9]), rows + np.array([0.5, 5.0, 9.5])
    assert random_effects(alike) < 0.001
    assert random_effects(apart) > 0.1


@pytest.mark.parametrize(("trainings", "most"), [(0.0, 0.08), (1.0, 0.12)])
def test_without_an_effect_one_in_twenty_is_below_the_level(trainings: float, most: float) -> None:
    rng = np.random.default_rng(4)
    found = np.array([random_effects(table(rng, 25, 3, 1.0, trainings)) for _ in range(400)])
    assert 0.02 < np.mean(found < 0.05) < most


def test_holes_are_filled_by_rows_and_columns() -> None:
    additive = np.arange(6.0)[:, None] + np.array([1.0, 2.0, 4.0])
    holed = additive.copy()
    holed[0, 0] = holed[3, 2] = np.nan
    assert random_effects(holed) == pytest.approx(random_effects(additive), rel=1e-6)


@pytest.mark.parametrize("count", [1, 5, 14, 15, EXACT, EXACT + 1, 70])
def test_many_rows_at_once_are_decided_as_each_alone(count: int) -> None:
    rng = np.random.default_rng(count)
    rows = rng.normal(rng.uniform(-1.0, 1.0, (200, 1)) / count**0.5 * 3.0, 1.0, (200, count))
    rows[rng.random(rows.shape) < 0.2] = 0.0
    decided = differ(rows)
    assert decided.tolist() == [sign_flips(row) < LEVEL for row in rows]
    assert count < 6 or 20 < decided.sum() < 180


def test_two_large_differences_against_each_other_decide_nothing() -> None:
    rows = np.full((2, 40), 1e-3)
    rows[1, :2] = 100.0, -100.0
    assert differ(rows).tolist() == [True, False]
    assert differ(np.zeros((1, 5))).tolist() == [False]
