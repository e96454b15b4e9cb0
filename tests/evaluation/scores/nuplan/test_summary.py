"""Means of the closed-loop score: as theses print them, by type, and with intervals that do not claim perfection."""

from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.evaluation.scores.nuplan.score import ClosedLoop
from dohyo.evaluation.scores.nuplan.summary import (
    ScoredDrive,
    as_document,
    by_type,
    compare_closed_loop,
    score_records,
    summarise_closed_loop,
)
from dohyo.sumo_networks.errors import InvalidInputError
from tests.evaluation.builders import episode

GOOD = ClosedLoop(1, 1, 1, 1, 1, 1, 1, 1)
CRASH = ClosedLoop(0, 1, 1, 1, 0, 1, 0.5, 1, red_lights=2)


def drive(name: str, terms: ClosedLoop, kind: str = "turn") -> ScoredDrive:
    return ScoredDrive(name, 0, "ego", kind, terms)


def test_rates_are_shares_of_failures() -> None:
    summary = summarise_closed_loop([drive("a", GOOD), drive("b", CRASH)], lost=3)
    assert (summary.score.mean, summary.collisions.mean, summary.off_road.mean) == (50.0, 50.0, 0.0)
    assert summary.progress.mean == pytest.approx(75.0)
    assert summary.terms["time_to_collision"].mean == 50.0
    assert (summary.red_lights, summary.drives, summary.lost) == (2, 2, 3)


def test_lost_drives_count_as_zero_beside_the_score_that_leaves_them_out() -> None:
    summary = summarise_closed_loop([drive("a", GOOD)], lost=3)
    assert summary.score_lost_as_zero is not None
    assert (summary.score.mean, summary.score_lost_as_zero.mean, summary.score_lost_as_zero.n) == (100.0, 25.0, 4)
    assert summarise_closed_loop([drive("a", GOOD)]).score_lost_as_zero is None


def test_no_collision_in_ten_drives_is_no_proof_that_there_are_none() -> None:
    summary = summarise_closed_loop([drive(str(i), GOOD) for i in range(10)])
    assert summary.collisions.mean == 0.0
    assert summary.collisions.high is not None
    assert summary.collisions.high > 20.0


def test_types_keep_their_order_and_their_drives() -> None:
    types = by_type([drive("a", GOOD, "turn"), drive("b", CRASH, "stop"), drive("c", CRASH, "turn")])
    assert [(kind, one.drives, one.score.mean) for kind, one in types.items()] == [("turn", 2, 50.0), ("stop", 1, 0.0)]


def test_agents_are_compared_on_the_drives_of_both() -> None:
    first = [drive(str(i), GOOD) for i in range(7)]
    second = [drive(str(i), CRASH) for i in range(1, 11)]
    comparison = compare_closed_loop(first, second)
    assert (comparison.verdict, comparison.difference.n, comparison.difference.mean) == (">", 6, 100.0)


def test_the_document_holds_every_drive() -> None:
    document = as_document([drive("a", GOOD), drive("b", CRASH)])
    assert [one["score"] for one in document["drives"]] == [100.0, 0.0]
    assert document["types"]["turn"]["drives"] == 2


def test_a_record_without_a_reference_has_no_such_score() -> None:
    with pytest.raises(InvalidInputError, match="has no reference"):
        score_records([(episode(), Path("record.json"))])
