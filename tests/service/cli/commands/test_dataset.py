"""`dohyo dataset freeway`: days are made, kept, and told about."""

from __future__ import annotations

import sys
from pathlib import Path

import polars as pl
import pytest

from dohyo.service.cli import main


def dohyo(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["dohyo", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_a_day_is_made_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    order = ("dataset", "freeway", "--days", "1", "--easy", "0", "--hard", "0", "--seed", "3", "--out", str(tmp_path))
    assert dohyo(monkeypatch, *order) == 0
    assert "1 days made" in capsys.readouterr().out
    table = pl.read_parquet(tmp_path / "train" / "day-0001.parquet")
    assert table.height == 1440
    assert table.select(pl.col("^truth_.*$")).min_horizontal().min() < 15.0  # a Monday has its queue
    assert dohyo(monkeypatch, *order) == 0
    assert "0 days made" in capsys.readouterr().out
    assert dohyo(monkeypatch, *(part.replace("3", "4") if part == "3" else part for part in order)) == 2
    error = capsys.readouterr().err
    assert error.startswith("dohyo: ")
    assert "has a different dataset: expected seed 4, got 3" in error
    assert error.count("\n") == 1
