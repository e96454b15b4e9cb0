"""The bar of progress: one line, and none for refusals and finished work."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from dohyo.service.cli import progress
from dohyo.service.cli.progress import ProgressBar

NOTE = "precrash.cut-in-3 s12: failed: agent deviated from the route"


def shown(monkeypatch: pytest.MonkeyPatch, columns: int, *reports: tuple[float, int, str]) -> list[str]:
    """Lines that a bar has written at its end."""
    written = io.StringIO()
    monkeypatch.setattr(progress, "console", Console(width=columns, file=written))
    with ProgressBar("hierarchical-master on precrash-conditions") as bar:
        for report in reports:
            bar(*report)
    return written.getvalue().splitlines()


@pytest.mark.parametrize("columns", [80, 120])
def test_the_progress_is_one_line(columns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    (line,) = shown(monkeypatch, columns, (0, 240, ""), (17.5, 240, NOTE))
    assert "hierarchical-mast" in line
    assert "17/240" in line
    assert "precrash" in line


def test_a_refusal_and_finished_work_show_none(monkeypatch: pytest.MonkeyPatch) -> None:
    assert shown(monkeypatch, 80) == []
    assert shown(monkeypatch, 80, (0, 0, ""), (4, 4, "")) == []
