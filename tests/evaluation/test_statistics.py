from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dohyo.evaluation import statistics
from dohyo.evaluation.statistics import (
    Estimate,
    grouped_estimate,
    mean_estimate,
    paired,
    percent_estimate,
    ratio_estimate,
    share_estimate,
    significantly_below,
)
from dohyo.sumo_networks.errors import InvalidInputError

values = st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=30)


def test_nothing_and_one_value_have_no_interval() -> None:
    assert mean_estimate([]) == Estimate(None, None, None, 0)
    assert mean_estimate([7.0]) == Estimate(7.0, None, None, 1)
    assert ratio_estimate([], [], floor=0.001) == Estimate(None, None, None, 0)
    assert ratio_estimate([3.0], [2.0], floor=0.001) == Estimate(1.5, None, None, 1)


def test_interval_agrees_with_theory() -> None:
    sample = np.random.default_rng(1).normal(50.0, 10.0, 400).tolist()
    estimate = mean_estimate(sample)
    half = 1.96 * np.std(sample, ddof=1) / math.sqrt(len(sample))
    assert estimate.mean == pytest.approx(np.mean(sample))
    assert estimate.low == pytest.approx(np.mean(sample) - half, abs=0.1)
    assert estimate.high == pytest.approx(np.mean(sample) + half, abs=0.1)


def test_interval_covers_the_truth_about_95_times_in_100() -> None:
    generator = np.random.default_rng(2)
    hits = 0
    for _ in range(200):
        estimate = mean_estimate(generator.normal(0.0, 1.0, 40).tolist(), n_resamples=500)
        assert estimate.low is not None
        assert estimate.high is not None
        hits += estimate.low <= 0.0 <= estimate.high
    assert 0.88 <= hits / 200 <= 0.99


def test_ratio_is_pooled_not_averaged() -> None:
    estimate = ratio_estimate([2.0, 1.0], [0.01, 2.99], floor=0.001)
    assert estimate.mean == pytest.approx(1.0)
    assert estimate.high == pytest.approx(200.0)


def test_ratio_never_divides_by_less_than_the_floor() -> None:
    assert ratio_estimate([1.0, 1.0], [0.0, 0.0], floor=0.001).mean == pytest.approx(2000.0)


@settings(deadline=None)
@given(values, st.randoms())
def test_order_does_not_matter(some: list[float], random: Callable[..., float]) -> None:
    mixed = some.copy()
    random.shuffle(mixed)  # type: ignore[attr-defined]
    assert mean_estimate(mixed, n_resamples=50) == mean_estimate(some, n_resamples=50)


@settings(deadline=None)
@given(values)
def test_interval_lies_within_the_values(some: list[float]) -> None:
    estimate = mean_estimate(some, n_resamples=50)
    slack = 1e-9 * max(map(abs, some))
    assert estimate.low is not None
    assert estimate.high is not None
    assert min(some) - slack <= estimate.low <= estimate.high <= max(some) + slack


def test_blocks_of_resamples_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    sample = np.random.default_rng(3).random(50).tolist()
    whole = mean_estimate(sample)
    monkeypatch.setattr(statistics, "_BLOCK", 1000)
    assert mean_estimate(sample) == whole


def test_pairing_sees_what_the_scenarios_spread_hides() -> None:
    generator = np.random.default_rng(4)
    difficulty = generator.uniform(0.0, 100.0, 60)
    a = difficulty + generator.normal(2.0, 1.0, 60)
    comparison = paired(a.tolist(), difficulty.tolist())
    assert comparison.verdict == ">"
    assert comparison.probability == 1.0
    assert comparison.difference.mean == pytest.approx(2.0, abs=0.5)
    assert paired(difficulty.tolist(), a.tolist()).verdict == "<"


def test_equals_are_as_likely_better_as_worse() -> None:
    assert paired([1.0] * 8, [1.0] * 8).probability == 0.5
    assert paired([2.0] * 5 + [1.0] * 95, [1.0] * 100).probability is None, "five of a hundred differ"
    assert paired([2.0] * 6 + [1.0] * 94, [1.0] * 100).probability is not None


def test_groups_of_one_are_independent_values() -> None:
    values = np.random.default_rng(6).normal(size=20).tolist()
    assert grouped_estimate([[value] for value in values], mean_estimate) == mean_estimate(values)


def test_copies_within_a_group_say_nothing_new() -> None:
    values = np.random.default_rng(7).normal(size=20).tolist()
    alone, copied = mean_estimate(values), grouped_estimate([[value] * 8 for value in values], mean_estimate)
    assert (copied.mean, copied.n) == (pytest.approx(alone.mean), 160)
    assert (copied.low, copied.high) == (pytest.approx(alone.low, abs=0.02), pytest.approx(alone.high, abs=0.02))


def test_where_all_succeed_a_group_counts_once() -> None:
    groups = [[100.0] * 8] * 3
    found, shares = grouped_estimate(groups, percent_estimate), share_estimate([True] * 3)
    assert (found.mean, found.low, found.high, found.n) == (shares.mean, shares.low, shares.high, 24)


def test_intervals_over_groups_hold_where_their_values_depend_on_each_other() -> None:
    generator, held = np.random.default_rng(8), 0
    for _ in range(200):
        shared = generator.normal(size=(30, 1)) + 0.3 * generator.normal(size=(30, 8))
        found = grouped_estimate(shared.tolist(), mean_estimate)
        held += found.low < 0.0 < found.high
    assert held >= 180, "of 200 intervals of 95 %; those over values alone hold 100"


@pytest.mark.parametrize(("pairs", "probability"), [(1, None), (5, None), (6, 1.0)])
def test_few_pairs_have_no_probability(pairs: int, probability: float | None) -> None:
    assert paired([2.0] * pairs, [1.0] * pairs).probability == probability


def test_what_is_alike_is_not_told_apart() -> None:
    assert paired([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]).verdict == "="
    noise = np.random.default_rng(5).normal(0.0, 1.0, 30)
    assert paired(noise.tolist(), (-noise).tolist()).difference.n == 30


def test_many_comparisons_at_once_have_the_verdicts_of_single_ones() -> None:
    generator = np.random.default_rng(0)
    best = generator.normal(0.0, 1.0, 9)
    others = best + generator.normal(-0.6, 1.0, (60, 9))  # about half are lower, some barely
    below = [paired(other.tolist(), best.tolist()).verdict == "<" for other in others]
    assert significantly_below(best, others).tolist() == below
    assert 10 < sum(below) < 50


@pytest.mark.parametrize("drives", [2, 4, 8, 18])
def test_verdicts_without_a_difference_are_one_in_twenty_at_most(drives: int) -> None:
    sample = np.random.default_rng(drives).normal(0.0, 1.0, (400, drives))
    zeros = [0.0] * drives
    assert np.mean([paired(row.tolist(), zeros).verdict != "=" for row in sample]) < 0.08


@pytest.mark.parametrize(("better", "verdict"), [(4, "="), (5, "="), (6, ">")])
def test_a_few_more_successes_among_many_drives_decide_nothing(better: int, verdict: str) -> None:
    successes = [100.0] * better + [0.0] * (150 - better)
    assert paired(successes, [0.0] * 150).verdict == verdict


def test_one_pair_decides_nothing() -> None:
    comparison = paired([100.0], [0.0])
    assert comparison.difference == Estimate(100.0, None, None, 1)
    assert comparison.verdict == "="


def test_bad_input_is_rejected() -> None:
    with pytest.raises(InvalidInputError, match="NaN"):
        mean_estimate([1.0, math.nan])
    with pytest.raises(InvalidInputError, match=r"\[2, 1\]"):
        paired([1.0, 2.0], [1.0])
    with pytest.raises(InvalidInputError, match="at least one"):
        paired([], [])
    with pytest.raises(InvalidInputError, match="floor"):
        ratio_estimate([1.0], [1.0], floor=0.0)
    with pytest.raises(InvalidInputError, match="resample"):
        mean_estimate([1.0, 2.0], n_resamples=0)


def test_thirty_of_thirty_is_no_proof_of_perfection() -> None:
    estimate = share_estimate([True] * 30)
    assert (estimate.mean, estimate.high) == (100.0, 100.0)
    assert estimate.low == pytest.approx(88.65, abs=0.01)


@given(st.integers(2, 200), st.data())
def test_a_share_lies_within_its_interval(n: int, data: st.DataObject) -> None:
    successes = data.draw(st.integers(0, n))
    estimate = share_estimate([True] * successes + [False] * (n - successes))
    assert estimate.mean is not None
    assert estimate.low is not None
    assert estimate.high is not None
    assert 0.0 <= estimate.low <= estimate.mean <= estimate.high <= 100.0
    mirrored = share_estimate([False] * successes + [True] * (n - successes))
    assert mirrored.low == pytest.approx(100.0 - estimate.high)


def test_a_rate_of_nothing_has_the_poisson_bound() -> None:
    assert ratio_estimate([0.0, 0.0], [4.0, 6.0], floor=0.001).high == pytest.approx(0.3689, abs=1e-4)
