"""Study `forecasting-mornings-long`: arms of `forecasting-mornings` with at most four times the updates.

    python -m dohyo.agents.studies forecasting-mornings-long run --set data=DIR

It tells which verdicts of that study are about networks that had learned all they could. "At most", since validations
are as many steps apart as in that study, so that patience may end a phase before its last one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from dohyo.agents.forecasting.study import mornings
from dohyo.agents.forecasting.study.arms import EQUAL, Variant
from dohyo.agents.forecasting.study.mornings import HARD
from dohyo.agents.forecasting.study.tables import AHEAD, cell, scale, verdicts
from dohyo.agents.studies.claims import Claim
from dohyo.agents.studies.crossed_bootstrap import dense_estimate
from dohyo.agents.studies.study import Results, judging
from dohyo.evaluation.report.style import markdown

LONG: Final = {
    "LSTM, MSE": "lstm-mse-x4",
    "ConvLSTM, MSE": "convlstm-mse-x4",
    "SA-LSTM, MSE": "sa-lstm-mse-x4",
    "SA-LSTM, balanced": "sa-lstm-lap3-balanced-x4",
    "n-step, balanced": "sa-lstm-n-step-lap3-balanced",
    "TSMixer": "tsmixer-mse-x4",
}


class Options(mornings.Options):
    """Options of a run: see `study.Options`."""

    steps: int = 800
    models: Path = Path("out/forecasting-mornings-long")

    @property
    def arms(self) -> Mapping[str, Variant]:
        """The arms that are trained longer."""
        return {arm: EQUAL[arm] for arm in LONG.values()}


def claims() -> list[Claim]:
    """Those of `forecasting-mornings` between these arms."""
    arms = set(LONG.values())
    some = [one for one in mornings.claims() if {one.left, one.right} <= arms]
    return [replace(one, told=f"{one}, at most 4 x the updates") for one in some]


judged = judging(claims(), interval=dense_estimate)


def section(results: Results) -> str:
    """Errors and verdicts; empty without rows."""
    if not results.rows:
        return ""
    rows = [[told, *(cell(results, arm, HARD, row) for row in AHEAD)] for told, arm in LONG.items()]
    table = markdown(["Hard, at most 4 x the updates", *(f"t+{row}" for row in AHEAD)], rows)
    return "\n\n".join((scale(results), table, verdicts(results, judged(results))))


STUDY: Final = replace(
    mornings.STUDY,
    summary="six of these forecasters with at most four times the updates",
    options=Options,
    tables={"mornings-long": section},
    judged=judged,
    published="mornings-long",
)
