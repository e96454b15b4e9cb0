"""`dohyo dataset freeway`: days are made, kept, and told about."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

import polars as pl
import pytest

from dohyo.service.cli import main
from tests import forked


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


def running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def below(pid: int) -> list[int]:
    """Processes that a process has started, and theirs."""
    own = [int(each) for task in Path(f"/proc/{pid}/task").glob("*/children") for each in task.read_text().split()]
    return [*own, *(one for each in own for one in below(each))]


@pytest.mark.parametrize(
    "command",
    [
        ("dataset", "freeway", "--days", "0", "--easy", "1", "--hard", "2", "--workers", "2", "--out", "days"),
        ("benchmarks", "prepare", "forecast-hard", "--workers", "2"),
    ],
    ids=lambda command: command[0],
)
def test_sigterm_ends_all_processes_and_leaves_nothing_half_written(command: tuple[str, ...], tmp_path: Path) -> None:
    temporary, home = tmp_path / "temporary", tmp_path / "home"
    temporary.mkdir()
    environment = os.environ | {"TMPDIR": str(temporary), "DOHYO_HOME": str(home)}
    process = forked.dohyo(*command, cwd=tmp_path, env=environment)
    process.wait_for(lambda: len(list(temporary.glob("dohyo-day-*"))) == 2)  # both are at work
    started = below(process.pid)
    try:
        assert process.end(signal.SIGTERM) == 130, process.errors()
        ends = time.monotonic() + 60.0
        while any(map(running, started)):
            assert time.monotonic() < ends
            time.sleep(0.05)
    finally:
        for pid in filter(running, started):
            os.kill(pid, signal.SIGKILL)
    assert len(started) >= 3
    (facts,) = tmp_path.rglob("dataset.json")
    assert [path for path in facts.parent.rglob("*") if path.is_file()] == [facts]
