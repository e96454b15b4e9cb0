"""Endings: what ended each mission is told with the speed and the light at its last decision."""

from __future__ import annotations

import pytest

from dohyo.agents.learning.runs.evaluation import Outcome
from dohyo.agents.rlad.study.endings import CAUSES, Decision, Ending, table


def ending(success: bool = False, **measures: float) -> Ending:
    told = {**dict.fromkeys(CAUSES, 0.0), "completion": 48.0, **measures}
    return Ending(Outcome(7, 169.6, 200, success, told), Decision(1.44, 0.36, "red or yellow"))


@pytest.mark.parametrize(
    ("one", "cause"),
    [
        (ending(success=True), "goal"),
        (ending(red_lights=1.0), "red light"),
        (ending(collision=1.0), "collision"),
        (ending(left_route=1.0), "beside the route"),
        (ending(blocked=1.0), "stands"),
        (ending(), "end of time"),
    ],
)
def test_every_ending_has_one_cause(one: Ending, cause: str) -> None:
    assert one.cause == cause


def test_the_table_has_a_row_per_mission() -> None:
    rows = table([ending(red_lights=1.0), ending(success=True)]).splitlines()[2:]
    assert rows[0] == "| 1 | 170 | 48 | red light | 1.4 | 0.4 | red or yellow |"
    assert len(rows) == 2
