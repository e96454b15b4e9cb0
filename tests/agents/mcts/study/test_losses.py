"""Points lost add up to what is missing, under the cause that lost them."""

from __future__ import annotations

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.agents.mcts.study.losses import CAUSES, losses
from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.scores.nuplan.score import ClosedLoop
from tests.evaluation.builders import ego, infraction

FLAWLESS = ClosedLoop(1, 1, 1, 1, 1, 1, 1, 1, 0)
PERSON = infraction(InfractionKind.COLLISION_PEDESTRIAN, at_fault=True)
NOT_OURS = infraction(InfractionKind.COLLISION_PEDESTRIAN, at_fault=False)


FOUR = {"min_size": 4, "max_size": 4}


@given(st.lists(st.floats(0, 1), **FOUR), st.lists(st.sampled_from([0.0, 0.5, 1.0]), **FOUR))
def test_they_add_up_to_what_is_missing(weighted: list[float], multiplying: list[float]) -> None:
    terms = ClosedLoop(*multiplying, *weighted, 0)
    lost = losses(terms, ego(PERSON))
    assert set(lost) == set(CAUSES)
    assert sum(lost.values()) == pytest.approx(100.0 - terms.score, abs=1e-9)


def test_each_term_loses_its_weight() -> None:
    lost = losses(dataclasses.replace(FLAWLESS, comfort=0.0, progress=0.5), ego())
    assert lost["comfort"] == pytest.approx(100 * 2 / 16)
    assert lost["progress"] == pytest.approx(100 * 2.5 / 16)
    assert sum(lost.values()) == pytest.approx(100 * 4.5 / 16)


@pytest.mark.parametrize(
    ("infractions", "cause"), [((PERSON,), "person"), ((NOT_OURS,), "no_collision"), ((), "no_collision")]
)
def test_a_collision_takes_all_under_whom_it_hit(infractions: tuple[Infraction, ...], cause: str) -> None:
    lost = losses(dataclasses.replace(FLAWLESS, no_collision=0.0, drivable_area=0.0, comfort=0.0), ego(*infractions))
    assert lost[cause] == 100.0
    assert sum(lost.values()) == 100.0
