"""Forecasts of tables that grow: only steps that have arrived, each once, and no end in an outage."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from dohyo.agents.forecasting.data.grid import Grid
from dohyo.agents.forecasting.data.reading import Format, read_latest
from dohyo.agents.forecasting.simple import Persistence
from dohyo.service.cli import app, following
from dohyo.service.cli.following import followed
from dohyo.sumo_networks.errors import InvalidInputError

START = datetime(2026, 3, 2, 9)
EVERY_S, IDLE_S = 0.01, 0.5


class Clock:
    """Stands for the module `time`: only a pause takes time, and none is waited for.

    Attributes:
        to_come: What happens during the pauses, by its time, s.
    """

    def __init__(self) -> None:
        self._now_s = 0.0
        self.to_come: list[tuple[float, Callable[[], object]]] = []

    def monotonic(self) -> float:
        return self._now_s

    def sleep(self, seconds: float) -> None:
        self._now_s += seconds
        while self.to_come and self.to_come[0][0] <= self._now_s:
            self.to_come.pop(0)[1]()


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """The clock of all readings: a slow machine takes no longer for them than another one."""
    made = Clock()
    monkeypatch.setattr(following, "time", made)
    return made


def line(minute: int, speed: float) -> str:
    return f"{START + timedelta(minutes=minute)},{speed:.1f}\n"


def table(path: Path, rows: int) -> Path:
    """One detector, a row a minute, at 90 km/h and a little more."""
    path.write_text("time,speed\n" + "".join(line(minute, 90 + minute % 3) for minute in range(rows)))
    return path


def add(path: Path, text: str) -> None:
    with path.open("a") as file:
        file.write(text)


def persistence(grid: Grid) -> tuple[Grid, Persistence]:
    return grid, Persistence(len(grid.names), grid.step_s)


def grids_of(*paths: Path, resample_s: float | None = None) -> Iterator[Grid]:
    """A table each time that it is forecast."""
    how = Format("km/h", resample_s=resample_s, growing=True)
    looks = followed(partial(read_latest, list(paths), how), persistence, EVERY_S, IDLE_S)
    return (grid for grid, _ in looks)


def minute(grid: Grid) -> float:
    """Minutes from the beginning to the last step."""
    return (grid.last_s - grid.start_s) / 60.0


def changing(path: Path, contents: Sequence[str | None]) -> Callable[[], Grid]:
    """Reads a table that has the next of these contents after each reading, and then keeps the last; None: no file."""
    to_come, last = iter(contents), contents[-1]
    read = partial(read_latest, [path], Format("km/h", growing=True))

    def reading() -> Grid:
        try:
            return read()
        finally:
            text = next(to_come, last)
            path.unlink(missing_ok=True) if text is None else path.write_text(text)

    return reading


def dohyo(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_step_is_due_once_every_file_has_it(tmp_path: Path) -> None:
    one, two = table(tmp_path / "one.csv", 20), table(tmp_path / "two.csv", 20)
    add(one, line(20, 95.0))
    grids = grids_of(one, two)
    assert minute(next(grids)) == 19
    add(two, line(20, 85.0))
    grid = next(grids)
    assert minute(grid) == 20
    np.testing.assert_allclose(3.6 * grid.speeds[-1], [95.0, 85.0], rtol=1e-4)
    assert list(grids) == []


def test_a_file_that_is_silent_delays_the_others_by_one_step(tmp_path: Path) -> None:
    one, two = table(tmp_path / "one.csv", 20), table(tmp_path / "two.csv", 20)
    grids = grids_of(one, two)
    assert minute(next(grids)) == 19
    add(one, line(20, 95.0) + line(21, 95.0))
    assert [minute(grid) for grid in grids] == [20]


def test_a_step_of_means_is_due_once_a_later_row_is_there(tmp_path: Path) -> None:
    path = table(tmp_path / "t.csv", 60)
    add(path, line(60, 30.0))
    grids = grids_of(path, resample_s=300.0)
    assert minute(next(grids)) == 55
    add(path, "".join(line(minute, 90.0) for minute in range(61, 66)))
    grid = next(grids)
    assert minute(grid) == 60
    assert 3.6 * grid.speeds[-1, 0] == pytest.approx((30 + 4 * 90) / 5, rel=1e-4)
    assert list(grids) == []


def test_half_a_number_is_no_speed(tmp_path: Path) -> None:
    path = table(tmp_path / "t.csv", 20)
    add(path, line(20, 45.3)[:-3])
    grids = grids_of(path)
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


def test_forecasts_that_differ_are_appended_and_others_are_already_there(tmp_path: Path) -> None:
    path, out = table(tmp_path / "t.csv", 20), tmp_path / "forecasts.csv"
    run = ("forecast", "run", "--data", path, "--model", "persistence", "--out", out)
    assert "written: " in dohyo(*run, "--unit", "km/h")
    again = dohyo(*run, "--unit", "km/h")
    assert "already there: " in again
    assert "written: " not in again
    path.write_text(path.read_text().replace(",9", ",7"))
    assert "written: " in dohyo(*run, "--unit", "km/h"), "other speeds at the same times"
    assert "written: " in dohyo(*run, "--unit", "mph")
    rows = list(csv.DictReader(out.open()))
    assert [(row["speed"], row["unit"]) for row in rows[::3]] == [
        ("91.000", "km/h"),
        ("71.000", "km/h"),
        ("71.000", "mph"),
    ]


def test_an_outage_is_told_once_and_then_forecasts_go_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = table(tmp_path / "t.csv", 20)
    grids = grids_of(path)
    assert minute(next(grids)) == 19
    add(path, "".join(f"{START + timedelta(minutes=minute)},\n" for minute in range(20, 30)) + line(30, 90.0))
    assert minute(next(grids)) == 30
    add(path, "".join(f"{START + timedelta(minutes=minute)},\n" for minute in range(31, 41)))
    assert list(grids) == [], "no forecast from eight steps without a speed"
    assert capsys.readouterr().err.count("expected a speed in the last 8 steps, got none; looking again") == 1


def test_a_file_that_is_rotated_is_followed_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = table(tmp_path / "t.csv", 20)
    later = "time,speed\n" + "".join(line(minute, 90.0) for minute in range(20, 30))
    looks = followed(changing(path, [None, None, "", "time,speed\n", later]), persistence, EVERY_S, IDLE_S)
    assert [len(grid.place) for grid, _ in looks] == [20, 10]
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 3, "absent, empty, without rows; the first two readings fail alike"
    assert "no file or folder" in told[0]


def minutes(rows: int) -> str:
    return "minute,speed\n" + "".join(f"{minute},90\n" for minute in range(rows))


def dates(*of: int) -> str:
    return "time,speed\n" + "".join(line(minute, 90.0) for minute in of)


@pytest.mark.parametrize(
    ("contents", "made"),
    [
        ([dates(*range(20), 5_000_000), dates(*range(22)), dates(*range(24))], 9 * 60 + 23),
        ([minutes(100), minutes(3), minutes(9), minutes(10)], 8),
        ([minutes(100), minutes(50), minutes(52)], 51),
        ([dates(*range(20)), dates(*range(-60, -50)), dates(*range(-60, -49))], 9 * 60 - 50),
    ],
    ids=["a wrong date is removed", "minutes begin again", "a shorter file", "a clock is set back"],
)
def test_forecasts_go_on_where_a_table_ends_earlier_than_before(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], contents: list[str], made: int
) -> None:
    path = tmp_path / "t.csv"
    path.write_text(contents[0])
    first, second, *_ = followed(changing(path, contents[1:]), persistence, EVERY_S, IDLE_S)
    assert first[1].made_s > second[1].made_s
    assert second[1].made_s % 86400 == 60 * made
    told = [one for one in capsys.readouterr().err.splitlines() if "the table ends at " in one]
    assert len(told) == 1
    assert ", before the last forecast at " in told[0]


def test_a_file_may_be_moved_right_after_it_was_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "t.csv"
    path.write_text("time,speed\n" + "".join(line(minute, 90.0).replace(",", "-05:00,") for minute in range(20)))
    read_bytes = Path.read_bytes

    def read_and_moved(file: Path) -> bytes:
        try:
            return read_bytes(file)
        finally:
            file.unlink()

    monkeypatch.setattr(Path, "read_bytes", read_and_moved)
    assert read_latest(path, Format("km/h", growing=True)).offset_s == -5 * 3600


def test_forecasts_wait_for_a_file_that_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    monkeypatch.setenv("PATH", "")  # no chromium, which takes seconds
    path, out, figure = table(tmp_path / "t.csv", 20), tmp_path / "forecasts.csv", tmp_path / "drawn" / "now.html"
    run = ["forecast", "run", "--data", str(path), "--unit", "km/h", "--model", "persistence", "--out", str(out)]

    def obstruct() -> None:
        out.rename(tmp_path / "kept.csv")
        out.mkdir()
        figure.unlink()
        figure.mkdir()
        add(path, line(20, 90.0))

    def clear() -> None:
        out.rmdir()
        (tmp_path / "kept.csv").rename(out)

    clock.to_come = [(0.0, obstruct), (1.0, lambda: add(path, line(21, 90.0))), (2.0, clear)]
    result = CliRunner().invoke(app, [*run, "--figure", str(figure), "--follow", "--every", "0.05", "--idle", "2.5"])
    assert result.exit_code == 0, result.output
    assert result.stderr.count(f"cannot write '{out}': Is a directory; forecasts are appended as soon as") == 1
    assert result.stderr.count(f"Is a directory; '{figure}' is drawn again with the next forecast") == 1
    assert result.stdout.count("not written yet: ") == 2
    written = [(row["made_at"], row["time"]) for row in csv.DictReader(out.open())]
    assert written == sorted(set(written))
    assert len(written) == 3 * 3


def test_a_first_reading_that_fails_ends_the_command(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="no file or folder"):
        next(grids_of(tmp_path / "none.csv"))


@pytest.mark.parametrize(("written", "read"), [("-05:00", "-05:00"), ("Z", "+00:00"), ("", "")])
def test_times_of_forecasts_have_the_offset_of_the_table(tmp_path: Path, written: str, read: str) -> None:
    path, out = tmp_path / "t.csv", tmp_path / "forecasts.csv"
    path.write_text("time,speed\n" + "".join(line(minute, 90.0).replace(",", f"{written},") for minute in range(20)))
    run = ("forecast", "run", "--data", path, "--unit", "km/h", "--model", "persistence", "--out", out)
    assert f"2026-03-02 09:19:00{read}: the next steps" in dohyo(*run)
    dohyo(*run)
    first, *others = csv.DictReader(out.open())
    assert (first["made_at"], first["time"]) == (f"2026-03-02 09:19:00{read}", f"2026-03-02 09:20:00{read}")
    assert len(others) == 2, "appended once"


def test_a_parquet_table_has_the_offset_of_its_zone(tmp_path: Path) -> None:
    times = pl.datetime_range(START, START + timedelta(minutes=19), "1m", time_zone="America/Chicago", eager=True)
    pl.DataFrame({"time": times, "speed": [90.0] * 20}).write_parquet(tmp_path / "t.parquet")
    assert read_latest(tmp_path / "t.parquet", Format("km/h")).offset_s == -6 * 3600


@pytest.mark.parametrize("command", ["run", "evaluate"])
def test_a_figure_that_cannot_be_written_costs_no_result(tmp_path: Path, command: str) -> None:
    path = table(tmp_path / "t.csv", 400)
    words = ("--data", path, "--unit", "km/h", "--model", "persistence", "--figure", path / "f.html")
    result = CliRunner().invoke(app, ["forecast", command, *map(str, words)])
    assert isinstance(result.exception, OSError)
    assert {"run": "2026-03-02 15:39:00: the next steps", "evaluate": "95 % over stretches"}[command] in result.output


@pytest.mark.parametrize("kept", [0, 20, 60, 150, 190, 200, 260])
def test_a_command_that_starts_again_after_a_kill_completes_the_forecast(tmp_path: Path, kept: int) -> None:
    path, out = table(tmp_path / "t.csv", 20), tmp_path / "forecasts.csv"
    run = ("forecast", "run", "--data", path, "--data", table(tmp_path / "u.csv", 20), "--unit", "km/h")
    dohyo(*run, "--model", "persistence", "--out", out)
    whole = out.read_bytes()
    assert len(whole) > 260
    out.write_bytes(whole[:kept])
    dohyo(*run, "--model", "persistence", "--out", out)
    assert out.read_bytes() == whole


def test_forecasts_are_appended_to_no_other_file(tmp_path: Path) -> None:
    path = table(tmp_path / "t.csv", 20)
    add(path, line(20, 90.0).rstrip())
    before = path.read_bytes()
    run = ["forecast", "run", "--data", str(path), "--unit", "km/h", "--model", "persistence", "--out", str(path)]
    result = CliRunner().invoke(app, run)
    assert "expected a new file or one of forecasts, which begins with made_at,time," in str(result.exception)
    assert path.read_bytes() == before


def test_the_rows_of_a_new_file_are_awaited_with_one_message(tmp_path: Path, clock: Clock) -> None:
    """Of a detector with a row each five minutes; one row or a few have no step that could be judged."""
    path, model, out = tmp_path / "t.csv", tmp_path / "m.safetensors", tmp_path / "forecasts.csv"
    lines = [line(5 * step, 90 + step % 5) for step in range(220)]
    path.write_text("time,speed\n" + "".join(lines[:200]))
    dohyo("forecast", "fit", "--data", path, "--unit", "km/h", "--model", "linear", "--out", model)
    run = ["forecast", "run", "--data", str(path), "--unit", "km/h", "--model", str(model), "--out", str(out)]

    def rotate(rows: int) -> None:
        path.write_text("time,speed\n" + "".join(lines[200 : 200 + rows]))

    clock.to_come = [(0.2 * rows, partial(rotate, rows)) for rows in range(10)]
    result = CliRunner().invoke(app, [*run, "--follow", "--every", "0.05", "--idle", "1.5"])
    assert result.exit_code == 0, result.output
    told = [one for one in result.stderr.splitlines() if "looking again" in one]
    assert [one for one in told if "min apart" in one] == []
    assert len([one for one in told if "expected a table of at least 8 steps" in one]) == 1
    assert len({row["made_at"] for row in csv.DictReader(out.open())}) == 3, "the last row before, and two with eight"
