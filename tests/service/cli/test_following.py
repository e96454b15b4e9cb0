"""Forecasts of tables that grow: only steps that have arrived, each once, and no end in an outage."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from dohyo.agents.forecasting.data.grid import Grid
from dohyo.agents.forecasting.data.reading import Format, read_latest
from dohyo.service.cli import app
from dohyo.service.cli.following import grown

START = datetime(2026, 3, 2, 9)
EVERY_S, IDLE_S = 0.01, 0.05


def line(minute: int, speed: float) -> str:
    return f"{START + timedelta(minutes=minute)},{speed:.1f}\n"


def table(path: Path, rows: int) -> Path:
    """One detector, a row a minute, at 90 km/h and a little more."""
    path.write_text("time,speed\n" + "".join(line(minute, 90 + minute % 3) for minute in range(rows)))
    return path


def add(path: Path, text: str) -> None:
    with path.open("a") as file:
        file.write(text)


def followed(*paths: Path, resample_s: float | None = None) -> Iterator[Grid]:
    how = Format("km/h", resample_s=resample_s, growing=True)
    return grown(partial(read_latest, list(paths), how), EVERY_S, IDLE_S)


def minute(grid: Grid) -> float:
    """Minutes from the beginning to the last step."""
    return (grid.last_s - grid.start_s) / 60.0


def dohyo(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_step_is_due_once_every_file_has_it(tmp_path: Path) -> None:
    one, two = table(tmp_path / "one.csv", 20), table(tmp_path / "two.csv", 20)
    add(one, line(20, 95.0))
    grids = followed(one, two)
    assert minute(next(grids)) == 19
    add(two, line(20, 85.0))
    grid = next(grids)
    assert minute(grid) == 20
    np.testing.assert_allclose(3.6 * grid.speeds[-1], [95.0, 85.0], rtol=1e-4)
    assert list(grids) == []


def test_a_file_that_is_silent_delays_the_others_by_one_step(tmp_path: Path) -> None:
    one, two = table(tmp_path / "one.csv", 20), table(tmp_path / "two.csv", 20)
    grids = followed(one, two)
    assert minute(next(grids)) == 19
    add(one, line(20, 95.0) + line(21, 95.0))
    assert [minute(grid) for grid in grids] == [20]


def test_a_step_of_means_is_due_once_a_later_row_is_there(tmp_path: Path) -> None:
    path = table(tmp_path / "t.csv", 20)
    add(path, line(20, 30.0))
    grids = followed(path, resample_s=300.0)
    assert minute(next(grids)) == 15
    add(path, "".join(line(minute, 90.0) for minute in range(21, 26)))
    grid = next(grids)
    assert minute(grid) == 20
    assert 3.6 * grid.speeds[-1, 0] == pytest.approx((30 + 4 * 90) / 5, rel=1e-4)
    assert list(grids) == []


def test_half_a_number_is_no_speed(tmp_path: Path) -> None:
    path = table(tmp_path / "t.csv", 20)
    add(path, line(20, 45.3)[:-3])
    grids = followed(path)
    assert minute(next(grids)) == 19
    add(path, ".3\n")
    assert 3.6 * next(grids).speeds[-1, 0] == pytest.approx(45.3, rel=1e-4)


def test_a_command_that_starts_again_appends_no_forecast_twice(tmp_path: Path) -> None:
    path, out = table(tmp_path / "t.csv", 20), tmp_path / "forecasts.csv"
    run = ("forecast", "run", "--data", path, "--unit", "km/h", "--model", "persistence", "--out", out)
    for _ in range(2):
        dohyo(*run)
        dohyo(*run, "--follow", "--every", 0.05, "--idle", 0.1)
    add(path, line(20, 90.0))
    dohyo(*run, "--follow", "--every", 0.05, "--idle", 0.1)
    written = [(row["made_at"], row["time"]) for row in csv.DictReader(out.open())]
    assert len(written) == len(set(written)) == 2 * 3
