"""Rescoring: the same numbers as the summary's where nothing is changed."""

from __future__ import annotations

import dataclasses

import pytest

from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.summary import summarise
from dohyo.service.evaluations.metrics import as_document
from dohyo.service.evaluations.rescoring import LAMBDA, rescore
from tests.evaluation.builders import ego, episode
from tests.service.evaluations.test_scoring import drives_of, entry


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


def test_a_cell_that_lost_all_drives_without_a_record_is_in_both_answers() -> None:
    record, unrecorded = episode(ego(), cell="town"), {"town": 1, "gone": 2}
    rescored = rescore([record], rules="2.0", unrecorded=unrecorded)
    metrics = as_document(entry("a", drives_of(record), lost=unrecorded))
    assert [*rescored["cells"]] == [*metrics["cells"]] == ["town", "gone"]
    for cell in (rescored["cells"]["gone"], metrics["cells"]["gone"]):
        assert (cell["lost"], cell["episodes"], cell["scores"]["driving_score"]["mean"]) == (2, 0, None)
        assert cell["scores_lost_as_zero"]["driving_score"]["mean"] == 0.0
    assert rescored["cells"]["gone"]["agent"] == rescored["agent"]
