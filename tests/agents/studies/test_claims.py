"""Claims: verdicts on both sides of every threshold, Holm's correction, and coverage on synthetic rows."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.claims import LEVEL, Claim, holm, judge, judge_rows, verdict
from dohyo.agents.studies.crossed_bootstrap import Matched, estimate, p_value
from dohyo.agents.studies.rows import Row


def pairs(*differences: float) -> Matched:
    """Values of an arm without training, a scenario each."""
    return {(f"m{i:03}",): {None: value} for i, value in enumerate(differences)}


def arms(**values: Matched):
    """Values for `judge`, by arm."""
    return lambda claim, arm: values.get(arm, {})


@pytest.mark.parametrize(
    ("relation", "mean", "p", "said"),
    [
        (">", 1.0, LEVEL - 1e-9, "reproduced"),
        (">", 1.0, LEVEL, "not resolved"),
        (">", -1.0, LEVEL - 1e-9, "contradicted"),
        ("<", -1.0, LEVEL - 1e-9, "reproduced"),
        ("<", 1.0, LEVEL - 1e-9, "contradicted"),
        ("<", -1.0, LEVEL, "not resolved"),
        ("=", 1.0, LEVEL - 1e-9, "contradicted"),
        ("=", -1.0, LEVEL - 1e-9, "contradicted"),
        ("=", 0.001, LEVEL, "not resolved"),
        (">", 0.0, 0.0, "not resolved"),
    ],
)
def test_a_verdict_follows_the_corrected_p_value_and_the_side(relation, mean, p, said):
    assert verdict(relation, mean, p) == said


def test_holms_correction_is_that_of_the_textbook():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.5, 0.9]) == [1.0, 1.0]
    assert holm([]) == []
    assert holm([0.02, 0.02, 0.02]) == pytest.approx([0.06, 0.06, 0.06])


def test_a_claim_that_is_resolved_alone_may_not_be_among_many():
    generator = np.random.default_rng(3)
    near = pairs(*generator.normal(0.45, 1.0, 30))
    zero = pairs(*[0.0] * 30)
    alone = judge([Claim("near", ">", "zero", "score")], arms(near=near, zero=zero))
    assert alone[0].verdict == "reproduced"
    noise = {f"noise-{i}": pairs(*generator.normal(0.0, 1.0, 30)) for i in range(20)}
    claims = [Claim("near", ">", "zero", "score"), *(Claim(name, ">", "zero", "score") for name in noise)]
    among = judge(claims, arms(near=near, zero=zero, **noise))
    assert among[0].p == alone[0].p
    assert among[0].adjusted > LEVEL
    assert {one.verdict for one in among} == {"not resolved"}


def test_only_common_scenarios_and_trainings_count_and_claims_without_any_are_left_out():
    left = {("m0",): {0: 5.0, 1: 7.0}, ("m1",): {0: 1.0}}
    right = {("m0",): {0: 2.0, 1: 3.0}, ("m2",): {0: 9.0}}
    claims = [Claim("left", ">", "right", "score"), Claim("left", ">", "nobody", "score")]
    (only,) = judge(claims, arms(left=left, right=right))
    assert only.difference.mean == pytest.approx(3.5)
    assert only.trainings == {0: 3.0, 1: 4.0}


def test_a_claim_is_judged_by_the_rows_of_its_place_that_have_a_value():
    def row(arm: str, benchmark: str, number: int, score: float | None) -> Row:
        return {**Cell(arm, None, benchmark, f"m{number}", 0)._asdict(), "score": score}

    rows = [row(arm, "town", number, base + number) for arm, base in (("a", 5.0), ("b", 3.0)) for number in range(9)]
    rows += [row(arm, "city", 0, base) for arm, base in (("a", 0.0), ("b", 20.0))]
    rows += [row("a", "town", 9, None), row("b", "town", 9, 99.0), {**row("a", "town", 10, None), "lost": "died"}]
    claims = [Claim("a", ">", "b", "score", where) for where in ("town", "city", "")]
    town, city, every = judge_rows(claims, rows)
    assert [(one.difference.mean, one.difference.n) for one in (town, city, every)] == [
        (2.0, 9),
        (-20.0, 1),
        (-0.2, 10),
    ]
    (south,) = judge_rows([Claim("a", ">", "b", "score", "m0")], rows, at=lambda row, where: row["scenario"] == where)
    assert south.difference.n == 2
    assert town.verdict == "reproduced"


@pytest.mark.parametrize(
    ("left", "right", "resolved"),
    [
        ([None], [None], True),
        ([0, 1, 2], [None], True),
        ([0, 1, 2], [0, 1, 2], True),
        ([0, 1], [None], False),
        ([0, 1, 2], [0, 1], False),
        ([0], [0], False),
    ],
)
def test_a_verdict_on_trained_arms_needs_three_trainings(left, right, resolved):
    def trained(seeds: list[int | None], value: float) -> Matched:
        return {(f"m{i:03}",): dict.fromkeys(seeds, value + i) for i in range(20)}

    (one,) = judge([Claim("a", ">", "b", "score")], arms(a=trained(left, 5.0), b=trained(right, 1.0)))
    assert one.difference.mean == pytest.approx(4.0)
    assert one.verdict == ("reproduced" if resolved else "not resolved")
    assert one.few_trainings is (one.p == 1.0) is (not resolved)


@pytest.mark.parametrize(
    ("scenarios", "seeds", "told"),
    [
        (4, range(3), "4 scenarios"),
        (5, [None], "5 scenarios"),
        (6, range(3), ""),
        (1, [None], "1 scenario"),
        (1, range(5), ""),  # a return of the training itself, judged over trainings
        (4, range(2), "2 trainings"),
    ],
)
def test_a_claim_of_fewer_than_six_scenarios_says_that_it_cannot_be_resolved(scenarios, seeds, told):
    some = {(f"m{i}",): {seed: 50.0 + i + 0.1 * (seed or 0) for seed in seeds} for i in range(scenarios)}
    zero = {key: dict.fromkeys(seeds, 0.0) for key in some}
    (one,) = judge([Claim("a", ">", "b", "score")], arms(a=some, b=zero))
    assert one.too_few == told
    assert (one.verdict == "not resolved") is bool(told)


def test_claims_of_few_scenarios_stay_in_the_list_of_the_correction():
    generator = np.random.default_rng(3)
    near, zero = pairs(*generator.normal(0.45, 1.0, 30)), pairs(*[0.0] * 30)
    claims = [Claim("near", ">", "zero", "score"), *[Claim("few", ">", "zero", "score")] * 9]
    alone, *rest = judge(claims, arms(near=near, zero=zero, few=pairs(9.0, 8.0, 7.0, 6.0)))
    assert alone.adjusted == pytest.approx(min(1.0, 10 * alone.p))
    assert {(one.p, one.verdict) for one in rest} == {(0.125, "not resolved")}


def test_claims_of_few_trainings_make_no_other_claim_easier():
    generator = np.random.default_rng(3)
    near, zero = pairs(*generator.normal(0.45, 1.0, 30)), pairs(*[0.0] * 30)
    once = {key: {0: 1.0} for key in near}
    claims = [Claim("near", ">", "zero", "score"), *[Claim("once", ">", "zero", "score")] * 9]
    alone, *rest = judge(claims, arms(near=near, zero=zero, once=once))
    assert alone.adjusted == pytest.approx(min(1.0, 10 * alone.p))
    assert {(one.adjusted, one.verdict) for one in rest} == {(1.0, "not resolved")}


@pytest.mark.parametrize(("count", "resolved"), [(5, False), (6, True)])
def test_no_fewer_pairs_than_a_sign_test_needs_resolve_a_claim(count, resolved):
    assert (p_value(pairs(*[1.0 + i for i in range(count)])) < LEVEL) is resolved


def test_the_p_value_is_that_of_the_interval():
    generator = np.random.default_rng(0)
    for shift in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6):
        differences = pairs(*generator.normal(shift, 1.0, 40))
        found, p = estimate(differences), p_value(differences)
        assert found.low is not None
        if abs(p - LEVEL) > 0.02:
            assert (p < LEVEL) == (found.low > 0.0)


def test_without_an_effect_a_list_of_claims_has_a_false_verdict_in_few_studies():
    generator = np.random.default_rng(1)
    zero = pairs(*[0.0] * 30)
    false = 0
    for _ in range(60):
        noise = {f"arm-{i}": pairs(*generator.normal(0.0, 1.0, 30)) for i in range(8)}
        judged = judge([Claim(name, ">", "zero", "score") for name in noise], arms(zero=zero, **noise))
        false += any(one.verdict != "not resolved" for one in judged)
    assert false <= 9  # of 60 at most 5 % are expected; uncorrected it would be a third


def test_intervals_hold_the_truth_as_often_as_they_say_with_many_trainings():
    generator = np.random.default_rng(2)
    held = 0
    for _ in range(200):
        effects = generator.normal(0, 1, (20, 1)) + generator.normal(0, 1, (1, 20)) + generator.normal(0, 1, (20, 20))
        crossed = {(f"m{i:02}",): dict(enumerate(row)) for i, row in enumerate((effects + 3.0).tolist())}
        found = estimate(crossed)
        assert found.low is not None
        assert found.high is not None
        held += found.low <= 3.0 <= found.high
    assert held / 200 >= 0.90
