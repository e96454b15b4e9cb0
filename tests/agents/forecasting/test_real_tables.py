"""Tables as detectors write them: times off the grid, duplicates, several files, odd units, a file that grows."""

from __future__ import annotations

import csv
import datetime
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from dohyo.agents.forecasting.data.grid import Rows, on_grid
from dohyo.agents.forecasting.data.reading import Format, read_data, read_latest
from dohyo.agents.forecasting.live.now import forecast_now
from dohyo.agents.forecasting.simple import Persistence
from dohyo.service.cli import app, following
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.forecasting.roads import road_speeds

START = datetime.datetime(2024, 3, 4, 5)


def rows(times_min: FloatArray, speeds: FloatArray, source: str = "a.csv") -> Rows:
    return Rows(source, 60.0 * times_min, ("s",), speeds[:, None].astype(np.float32))


def write(path: Path, speeds: FloatArray, off_s: FloatArray | None = None, per_mps: float = 3.6) -> Path:
    """A table of one detector, a row every five minutes from START on, each so many seconds late."""
    late = np.zeros(len(speeds)) if off_s is None else off_s
    lines = [
        f"{START + datetime.timedelta(minutes=5 * i, seconds=float(late[i]))},{per_mps * speed:.2f}"
        for i, speed in enumerate(speeds)
    ]
    path.write_text("timestamp,value\n" + "\n".join(lines) + "\n")
    return path


def dohyo(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words])
    if isinstance(result.exception, InvalidInputError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.stdout


def test_rows_off_the_grid_are_moved_duplicates_averaged_and_both_are_said() -> None:
    times = np.array([0.0, 5.0, 5.0, 10.9, 15.0, 27.4])
    grid = on_grid([rows(times, np.array([10.0, 20, 22, 30, 40, 50]))], 300.0, 0.5, None)
    assert grid.place.tolist() == [0, 1, 2, 3, 5]
    np.testing.assert_allclose(grid.speeds[:, 0], [10, 21, 30, 40, 50])
    assert "1 of 6 rows lie more than a quarter of a step off" in grid.notes[0]
    strict = on_grid([rows(times, np.arange(6.0))], 300.0, 0.3, None)
    assert strict.place.tolist() == [0, 1, 2, 3], "the last row is left out, and so is missing"
    (stretch,) = grid.stretches("a")
    assert np.isnan(stretch.speeds[4, 0])


def test_longer_steps_have_means_and_shorter_ones_are_refused() -> None:
    speeds = np.array([10.0, 20, np.nan, 40, 50, 60])
    grid = on_grid([rows(5.0 * np.arange(6), speeds)], None, 0.5, 900.0)
    np.testing.assert_allclose(grid.speeds[:, 0], [15.0, 50.0])
    with pytest.raises(InvalidInputError, match="expected --resample of at least 5 minutes"):
        on_grid([rows(5.0 * np.arange(6), speeds)], None, 0.5, 60.0)


def test_several_files_are_joined_by_time() -> None:
    one, two = rows(5.0 * np.arange(4), np.arange(4.0)), rows(5.0 * np.arange(2, 6), np.arange(4.0), "there/b.csv")
    grid = on_grid([one, two], None, 0.5, None)
    assert grid.names == ("a", "b")
    np.testing.assert_allclose(grid.speeds[2:4], [[2.0, 0.0], [3.0, 1.0]])
    assert np.isnan(grid.speeds[[0, 1], 1]).all()


def test_rows_left_out_count_as_missing_and_a_unit_may_be_trusted(tmp_path: Path) -> None:
    speeds = road_speeds(250, 1)[:, 0]
    lines = write(tmp_path / "t.csv", speeds, per_mps=4.6).read_text().splitlines()
    (tmp_path / "t.csv").write_text("\n".join([lines[0], *(line for i, line in enumerate(lines[1:]) if i % 5 < 3)]))
    with pytest.raises(InvalidInputError, match=r"lacks 39 % of its values.*--max-missing.*--resample"):
        read_data(tmp_path / "t.csv", Format("km/h"))
    with pytest.raises(InvalidInputError, match=r"if mph is right: --trust-unit"):
        read_data(tmp_path / "t.csv", Format("mph", max_missing=0.5))
    data = read_data(tmp_path / "t.csv", Format("mph", max_missing=0.5, trust_unit=True))
    assert data.missing == pytest.approx(0.4, abs=0.02)


def test_a_forecast_now_is_of_the_last_complete_row_with_the_errors_of_the_past(tmp_path: Path) -> None:
    table = write(tmp_path / "t.csv", np.full(60, 20.0) + np.arange(60) % 2)
    with table.open("a") as file:
        file.write("2024-03-04 10:")
    forecast = forecast_now(Persistence(1, 300.0), read_latest(table, Format("km/h")))
    assert forecast.made_s == (START + datetime.timedelta(minutes=295)).replace(tzinfo=datetime.UTC).timestamp()
    np.testing.assert_allclose(forecast.ahead, 21.0, atol=0.01)
    np.testing.assert_allclose((forecast.high - forecast.low)[:, 0], [2.0, 0.0, 2.0], atol=0.45)
    short = write(tmp_path / "short.csv", np.full(5, 20.0))
    with pytest.raises(InvalidInputError, match="at least 8 steps, got 5"):
        forecast_now(Persistence(1, 300.0), read_latest(short, Format("km/h")))


def test_the_commands_follow_a_file_that_grows_and_compare_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    speeds = road_speeds(400, 1)[:, 0]
    table = write(tmp_path / "t.csv", speeds[:300], np.tile([0.0, 40.0, 140.0], 100))
    words = ("--data", table, "--unit", "km/h", "--model")
    fitted = json.loads(dohyo("forecast", "fit", *words, "linear", "--out", tmp_path / "m.safetensors", "--json"))
    low, high = fitted["sets"]["test"]["linear"]["rmse_kmh_interval"][0] or (None, None)
    assert low is None or low <= fitted["sets"]["test"]["linear"]["rmse_kmh"][0] <= high
    assert "off the grid" in fitted["notes"][0]
    with pytest.raises(InvalidInputError, match=r"forecasts rows 5 min apart, those of .* are 15 min apart; train one"):
        dohyo("forecast", "run", *words, tmp_path / "m.safetensors", "--resample", 15)
    lines = write(tmp_path / "later.csv", speeds[:302]).read_text().splitlines()

    now_s, growth = [0.0], ["\n".join(lines[-2:]) + "\n"]

    def wait(seconds: float) -> None:
        now_s[0] += seconds
        if growth:
            assert (tmp_path / "out.csv").exists()
            with table.open("a") as file:
                file.write(growth.pop())

    monkeypatch.setattr(following, "time", SimpleNamespace(monotonic=lambda: now_s[0], sleep=wait))
    run = ("forecast", "run", *words, tmp_path / "m.safetensors", "--out", tmp_path / "out.csv", "--follow")
    dohyo(*run, "--every", 0.5, "--idle", 1.5)
    assert now_s[0] == 2.5, "half a second until it grew, and then without a step"
    written = list(csv.DictReader((tmp_path / "out.csv").open()))
    assert len({row["made_at"] for row in written}) == 2
    assert all(float(row["low"]) <= float(row["speed"]) <= float(row["high"]) for row in written)


@pytest.mark.parametrize("late_s", [0.0, 100.0, 155.0, -60.0])
def test_a_first_row_at_another_time_moves_no_other_one(tmp_path: Path, late_s: float) -> None:
    random = np.random.default_rng(0)
    off_s = np.concatenate([[60.0 + late_s], 60.0 + random.uniform(0.0, 20.0, 399)])
    table = write(tmp_path / "t.csv", 20.0 + np.arange(400) % 2, off_s)
    grid = read_latest(table, Format("km/h"))
    np.testing.assert_array_equal(grid.place, np.arange(400))
    lines = table.read_text().splitlines(keepends=True)
    table.write_text("".join(lines[:101]))
    assert read_latest(table, Format("km/h")).start_s == grid.start_s, "a table that grows keeps its steps"


def test_one_row_of_a_second_file_has_no_step_that_could_differ(tmp_path: Path) -> None:
    paths = [write(tmp_path / f"{name}.csv", np.full(rows, 20.0)) for name, rows in (("one", 1), ("all", 40))]
    assert read_latest(paths, Format("km/h")).step_s == 300.0


def test_times_with_a_zone_and_without_are_not_joined(tmp_path: Path) -> None:
    start = datetime.datetime(2026, 3, 2)
    times = [start + datetime.timedelta(minutes=5 * i) for i in range(200)]
    for name, zone in (("zoned", "+01:00"), ("local", ""), ("utc", "Z")):
        lines = [f"{time.isoformat()}{zone},{20 + i % 5}" for i, time in enumerate(times)]
        (tmp_path / f"{name}.csv").write_text("\n".join([f"time,{name}", *lines]) + "\n")
    unix = [f"{1772406000 + 300 * i},{20 + i % 5}" for i in range(200)]
    (tmp_path / "unix.csv").write_text("\n".join(["time,unix", *unix]) + "\n")
    zoned, local, utc, numbers = (tmp_path / f"{name}.csv" for name in ("zoned", "local", "utc", "unix"))
    for paths in ((zoned, local), (local, utc, zoned)):
        message = r"local\.csv': expected times with an offset from UTC, as in '.*\.csv', got times without one"
        with pytest.raises(InvalidInputError, match=message):
            read_latest(paths)
    assert read_latest([zoned, utc]).steps == 200 + 11, "an hour apart, and the last step has not arrived"
    assert read_latest([numbers, zoned], Format(step_s=300.0)).steps == 200, "seconds since 1970 are in UTC"
