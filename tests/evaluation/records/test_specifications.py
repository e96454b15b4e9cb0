"""Every kind of infraction and every status is specified once, and completely."""

from __future__ import annotations

from collections import Counter

import pytest

from dohyo.evaluation.criteria import criterion_types
from dohyo.evaluation.records.specifications import COLLISIONS, InfractionKind, Outcome, Status


def test_every_kind_has_one_criterion_and_they_are_asked_in_the_order_of_the_kinds() -> None:
    detected = [kind for criterion in criterion_types() for kind in criterion.kinds]
    assert Counter(detected) == Counter(InfractionKind)
    order = list(InfractionKind)
    firsts = [order.index(criterion.kinds[0]) for criterion in criterion_types()]
    assert firsts == sorted(firsts)


@pytest.mark.parametrize("kind", InfractionKind)
def test_a_specification_is_consistent(kind: InfractionKind) -> None:
    one = kind.specification
    assert one.label
    assert one.mark.path.startswith("M")
    assert one.ends is None or one.penalty is None  # what ends a drive costs its route completion
    assert one.ends not in (Status.PERFECT, Status.COMPLETED, Status.FINISHED, Status.COLLIDED)
    assert one.collision == kind.startswith("collision_") == (kind in COLLISIONS)
    if one.penalty is not None:
        assert 0.0 < one.penalty.factor_of(50.0) < 1.0
        assert one.penalty.cost_of(50.0) > 0.0


def test_labels_are_distinct() -> None:
    assert len({kind.specification.label for kind in InfractionKind}) == len(InfractionKind)


@pytest.mark.parametrize("status", Status)
def test_a_status_is_what_its_first_word_says(status: Status) -> None:
    said, _, _ = status.value.partition(":")
    assert status.infrastructure_fault == (said == "lost")
    assert (status.outcome is Outcome.SUCCESS) == (":" not in status.value)
    assert not (status.completed and status.agent_fault)


@pytest.mark.parametrize(
    ("percent", "factor", "cost"), [(0.0, 0.7, 0.4), (50.0, 0.85, 0.2), (100.0, 1.0, 0.0), (120.0, 1.0, 0.0)]
)
def test_the_penalty_of_a_low_speed_is_in_proportion_to_what_is_missing(
    percent: float, factor: float, cost: float
) -> None:
    penalty = InfractionKind.MINIMUM_SPEED.specification.penalty
    assert penalty is not None
    assert (penalty.factor_of(percent), penalty.cost_of(percent)) == pytest.approx((factor, cost))
