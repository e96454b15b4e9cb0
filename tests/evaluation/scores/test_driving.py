from __future__ import annotations

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from dohyo.evaluation.records.record import EgoRecord, Infraction
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.scores.driving import (
    Rules,
    driving_score,
    infraction_penalty,
    infraction_rate_score,
    outside_fraction,
    route_completion,
)
from dohyo.sumo_networks.errors import InvalidInputError
from tests.evaluation.builders import ego, infraction

RULES: tuple[Rules, ...] = ("1.0", "2.0", "2.1")
PEDESTRIAN = infraction(InfractionKind.COLLISION_PEDESTRIAN)
VEHICLE = infraction(InfractionKind.COLLISION_VEHICLE)
STATIC = infraction(InfractionKind.COLLISION_STATIC)
RED = infraction(InfractionKind.RED_LIGHT)
STOP = infraction(InfractionKind.STOP_SIGN)
TOO_LONG = infraction(InfractionKind.SCENARIO_TIMEOUT, magnitude=240.0)
NOT_YIELDING = infraction(InfractionKind.YIELD_EMERGENCY, magnitude=12.0)


def slow(percent: float) -> Infraction:
    return infraction(InfractionKind.MINIMUM_SPEED, magnitude=percent)


@st.composite
def infractions(draw: st.DrawFn) -> Infraction:
    kind = draw(st.sampled_from(InfractionKind))
    return infraction(kind, magnitude=draw(st.floats(0.0, 150.0)))


@st.composite
def drives(draw: st.DrawFn) -> EgoRecord:
    driven_m = draw(st.floats(1.0, 1e5))
    return ego(
        *draw(st.lists(infractions(), max_size=8)),
        status=draw(st.sampled_from([Status.COMPLETED, Status.TIMED_OUT, Status.AGENT_RAISED])),
        route_length_m=draw(st.floats(1.0, 1e5)),
        progress_m=draw(st.floats(0.0, 1e5)),
        driven_m=driven_m,
        outside_lanes_m=draw(st.floats(0.0, 1.0)) * driven_m,
    )


def worse(drive: EgoRecord, one: Infraction) -> EgoRecord:
    return drive.model_copy(update={"infractions": (*drive.infractions, one)})


def doubled(drive: EgoRecord) -> EgoRecord:
    lengths = ("route_length_m", "progress_m", "driven_m", "outside_lanes_m")
    twice = {name: 2.0 * getattr(drive, name) for name in lengths}
    return drive.model_copy(update={**twice, "infractions": drive.infractions * 2})


@pytest.mark.parametrize(("rules", "expected"), [("1.0", 20.16), ("2.0", 20.16), ("2.1", 28.57)])
def test_two_vehicle_hits_and_a_red_light_at_80_percent(rules: Rules, expected: float) -> None:
    assert driving_score(ego(VEHICLE, VEHICLE, RED), rules) == pytest.approx(expected, abs=0.005)


@pytest.mark.parametrize(
    ("one", "factor", "cost"),
    [
        (PEDESTRIAN, 0.50, 1.0),
        (VEHICLE, 0.60, 0.7),
        (STATIC, 0.65, 0.6),
        (RED, 0.70, 0.4),
        (STOP, 0.80, 0.25),
        (TOO_LONG, 0.70, 0.4),
        (NOT_YIELDING, 0.70, 0.4),
        (slow(0.0), 0.70, 0.4),
        (slow(50.0), 0.85, 0.2),
        (slow(100.0), 1.0, 0.0),
        (slow(130.0), 1.0, 0.0),
        (infraction(InfractionKind.OUTSIDE_LANES, magnitude=300.0), 1.0, 0.0),
        (infraction(InfractionKind.ROUTE_DEVIATION), 1.0, 0.0),
        (infraction(InfractionKind.BLOCKED), 1.0, 0.0),
        (infraction(InfractionKind.ROUTE_TIMEOUT), 1.0, 0.0),
    ],
)
def test_each_infraction_alone(one: Infraction, factor: float, cost: float) -> None:
    assert infraction_penalty([one], "2.0", 0.0) == pytest.approx(factor)
    assert infraction_penalty([one], "2.1", 0.0) == pytest.approx(1.0 / (1.0 + cost))


def test_minimum_speed_counts_once_per_checkpoint_and_not_at_all_under_1_0() -> None:
    assert infraction_penalty([slow(50.0)] * 3, "2.0", 0.0) == pytest.approx(0.85**3)
    assert infraction_penalty([slow(50.0)] * 3, "1.0", 0.0) == 1.0


def test_scripted_events_count_since_2_0() -> None:
    assert infraction_penalty([TOO_LONG, NOT_YIELDING, RED], "1.0", 0.0) == pytest.approx(0.7)
    assert infraction_penalty([TOO_LONG, NOT_YIELDING, RED], "2.0", 0.0) == pytest.approx(0.7**3)


@pytest.mark.parametrize("rules", RULES)
def test_driving_outside_the_lanes_multiplies(rules: Rules) -> None:
    clean, dirty = ego(RED), ego(RED, outside_lanes_m=200.0)
    assert driving_score(dirty, rules) == pytest.approx(0.75 * driving_score(clean, rules))


@pytest.mark.parametrize("rules", RULES)
@pytest.mark.parametrize("driven_m", [800.0, 8000.0])
def test_circles_dilute_neither_outside_nor_the_rate_score(rules: Rules, driven_m: float) -> None:
    drive = ego(RED, driven_m=driven_m, outside_lanes_m=200.0)
    assert outside_fraction(drive) == pytest.approx(0.25)
    assert driving_score(drive, rules) == pytest.approx(0.75 * driving_score(ego(RED), rules))
    assert infraction_rate_score(drive) == pytest.approx(80.0 * 0.75 * math.exp(-4.0 * 0.3 / 0.8))


def test_more_metres_outside_than_completed_are_all() -> None:
    assert outside_fraction(ego(driven_m=5000.0, outside_lanes_m=900.0)) == 1.0
    assert outside_fraction(ego(progress_m=0.0, driven_m=5.0, outside_lanes_m=5.0)) == 1.0


def test_an_ego_that_never_moved_was_never_outside() -> None:
    assert outside_fraction(ego(progress_m=0.0)) == 0.0


@pytest.mark.parametrize(
    ("status", "progress_m", "expected"),
    [(Status.PERFECT, 998.5, 100.0), (Status.COMPLETED, 1000.0, 100.0), (Status.BLOCKED, 250.0, 25.0)],
)
def test_route_completion(status: Status, progress_m: float, expected: float) -> None:
    assert route_completion(ego(status=status, progress_m=progress_m)) == expected


def test_only_the_goal_gives_100_percent() -> None:
    assert 99.99 < route_completion(ego(progress_m=1001.0)) < 100.0


def test_infraction_rate_score_by_hand() -> None:
    drive = ego(VEHICLE, RED, driven_m=500.0)
    assert infraction_rate_score(drive) == pytest.approx(80.0 * math.exp(-4.0 * (0.4 + 0.3) / 0.8))
    assert infraction_rate_score(drive, length="driven") == pytest.approx(80.0 * math.exp(-4.0 * (0.4 + 0.3) / 0.5))
    assert infraction_rate_score(drive, length="route") == pytest.approx(80.0 * math.exp(-4.0 * (0.4 + 0.3) / 1.0))
    assert infraction_rate_score(drive, lambda_=0.0) == pytest.approx(80.0)


def test_infraction_rate_score_of_an_ego_that_never_moved() -> None:
    drive = ego(RED, status=Status.COMPLETED, progress_m=0.0)
    assert infraction_rate_score(drive, length="driven") < 1e-100
    assert infraction_rate_score(ego(RED, progress_m=0.0)) == 0.0


@given(drives())
def test_scores_stay_in_their_range(drive: EgoRecord) -> None:
    for rules in RULES:
        assert 0.0 <= infraction_penalty(drive.infractions, rules, outside_fraction(drive)) <= 1.0
        assert 0.0 <= driving_score(drive, rules) <= 100.0
    assert 0.0 <= infraction_rate_score(drive) <= 100.0
    assert 0.0 <= infraction_rate_score(drive, length="route") <= 100.0


@given(drives(), infractions())
def test_one_more_infraction_never_raises_a_score(drive: EgoRecord, one: Infraction) -> None:
    for rules in RULES:
        assert driving_score(worse(drive, one), rules) <= driving_score(drive, rules)
    assert infraction_rate_score(worse(drive, one)) <= infraction_rate_score(drive)
    assert infraction_rate_score(worse(drive, one), length="route") <= infraction_rate_score(drive, length="route")


@given(drives())
def test_rate_score_is_unchanged_when_route_and_infractions_double(drive: EgoRecord) -> None:
    assert infraction_rate_score(doubled(drive)) == pytest.approx(infraction_rate_score(drive), rel=1e-9)
    once, twice = infraction_rate_score(drive, length="route"), infraction_rate_score(doubled(drive), length="route")
    assert twice == pytest.approx(once, rel=1e-9)


@given(drives(), st.sampled_from([PEDESTRIAN, VEHICLE, STATIC, RED, STOP]), st.sampled_from(RULES))
def test_driving_score_falls_when_route_and_infractions_double(drive: EgoRecord, one: Infraction, rules: Rules) -> None:
    drive = worse(drive, one)
    assume(driving_score(drive, rules) > 1e-9)
    assert driving_score(doubled(drive), rules) < driving_score(drive, rules)


@given(st.permutations([PEDESTRIAN, VEHICLE, RED, STOP, slow(33.0)]), st.sampled_from(RULES))
def test_the_order_of_infractions_does_not_matter(some: list[Infraction], rules: Rules) -> None:
    in_order = [PEDESTRIAN, VEHICLE, RED, STOP, slow(33.0)]
    assert infraction_penalty(some, rules, 0.1) == infraction_penalty(in_order, rules, 0.1)


@pytest.mark.parametrize("name", ["progress_m", "route_length_m", "driven_m", "outside_lanes_m"])
def test_nan_is_rejected(name: str) -> None:
    broken = ego().model_copy(update={name: math.nan})
    with pytest.raises(InvalidInputError, match="finite"):
        infraction_rate_score(broken, length="driven" if name == "driven_m" else "completed")


def test_nan_in_an_infraction_is_rejected() -> None:
    broken = slow(50.0).model_copy(update={"magnitude": math.nan})
    with pytest.raises(InvalidInputError, match="minimum_speed"):
        infraction_penalty([broken], "2.0", 0.0)


@pytest.mark.parametrize("fraction", [math.nan, -0.1, 1.1])
def test_an_impossible_outside_fraction_is_rejected(fraction: float) -> None:
    with pytest.raises(InvalidInputError, match="outside fraction"):
        infraction_penalty([], "2.1", fraction)


def test_unknown_rules_lengths_and_lambdas_are_rejected() -> None:
    with pytest.raises(InvalidInputError, match=r"1\.0, 2\.0, 2\.1"):
        infraction_penalty([], "3.0", 0.0)  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="completed, driven, route"):
        infraction_rate_score(ego(), length="planned")  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="lambda"):
        infraction_rate_score(ego(), lambda_=math.nan)
