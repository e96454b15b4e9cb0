"""Rescoring: the same numbers as the summary's where nothing is changed."""

from __future__ import annotations

import dataclasses

import pytest

from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.summary import summarise
from dohyo.service.evaluations.rescoring import LAMBDA, rescore
from tests.evaluation.builders import ego, episode


@pytest.mark.parametrize("unrecorded", [0, 1])
def test_the_rate_score_with_lost_drives_is_that_of_the_summary(unrecorded: int) -> None:
    egos = [ego(name="one", status=Status.PERFECT), ego(name="two", status=Status.PERFECT)]
    gone = episode(ego(name="one", status=Status.GRIDLOCK), egos[1], seed=2)
    records = [episode(*egos, seed=0), episode(*egos, seed=1), gone]
    expected = summarise(records, unrecorded=unrecorded)
    found = rescore(records, rules="2.0", irs_lambda=LAMBDA, unrecorded={"all": unrecorded})
    assert expected.scores_lost_as_zero is not None
    assert found["scores_lost_as_zero"]["irs"] == dataclasses.asdict(expected.scores_lost_as_zero["irs"])
    assert found["cells"]["all"]["scores_lost_as_zero"] == found["scores_lost_as_zero"]
    assert (found["lost"], found["scores_lost_as_zero"]["irs"]["high"]) == (2 + unrecorded, 100.0)
