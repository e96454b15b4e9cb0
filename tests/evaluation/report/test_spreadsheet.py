"""CSV that spreadsheets open without harm."""

from __future__ import annotations

import csv
import io

import pytest

from dohyo.evaluation.report.spreadsheet import csv_text


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1"])
def test_what_a_spreadsheet_would_run_is_text(text: str) -> None:
    _, row = csv.reader(io.StringIO(csv_text(["agent"], [[text]]), newline=""))
    assert row == ["'" + text]


def test_numbers_and_gaps_stay_what_they_are() -> None:
    assert csv_text(["a", "b", "c"], [[-1.5, None, "="]]) == "a,b,c\n-1.5,,=\n"
