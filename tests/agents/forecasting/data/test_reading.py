"""Tables from anywhere: what is read, how gaps are filled, how days are split, one clear line for each bad one."""

from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dohyo.agents.forecasting.data.gaps import fill
from dohyo.agents.forecasting.data.reading import Format, read_data, read_latest
from dohyo.agents.forecasting.data.windows import make_windows
from dohyo.agents.forecasting.live.now import forecast_now
from dohyo.agents.forecasting.simple import Persistence
from dohyo.sumo_networks.arrays import IntArray
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from tests.agents.forecasting.roads import road_speeds, road_stretch, write_csv, write_folder

NAN = float("nan")


@pytest.mark.parametrize(("unit", "per_mps"), [("m/s", 1.0), ("km/h", 3.6), ("mph", 2.236936)])
def test_units_become_metres_per_second(tmp_path: Path, unit: str, per_mps: float) -> None:
    speeds = road_speeds(200, 4)
    data = read_data(write_csv(tmp_path / "t.csv", speeds, per_mps), Format(unit))
    got = np.concatenate([one.speeds for name in ("train", "validation", "test") for one in data.sets[name]])
    np.testing.assert_allclose(got, speeds, rtol=1e-3, atol=1e-2)
    assert (data.step_s, data.segments) == (60.0, ("s0", "s1", "s2", "s3"))


def test_parts_of_a_table_follow_each_other_in_time(tmp_path: Path) -> None:
    speeds = road_speeds(1000, 3)
    data = read_data(write_csv(tmp_path / "t.csv", speeds))
    assert [sum(len(one.speeds) for one in data.sets[n]) for n in ("train", "validation", "test")] == [700, 100, 200]
    np.testing.assert_allclose(data.sets["test"][-1].speeds[-1], speeds[-1], rtol=1e-3)


def test_many_days_are_split_by_day(tmp_path: Path) -> None:
    start = datetime.datetime(2024, 3, 1)
    times = [start + datetime.timedelta(minutes=15 * i) for i in range(20 * 96)]
    rng = np.random.default_rng(0)
    columns = {name: rng.uniform(5, 30, len(times)) for name in "ab"}
    pl.DataFrame({"timestamp": times, **columns}).write_csv(tmp_path / "t.csv")
    data = read_data(tmp_path / "t.csv")
    assert data.step_s == 900.0
    assert [len(data.sets[n]) for n in ("train", "validation", "test")] == [14, 2, 4]
    assert {len(one.speeds) for some in data.sets.values() for one in some} == {96}
    assert {one.start_s for some in data.sets.values() for one in some} == {0.0}


@pytest.mark.parametrize("flaky", [(0, 1), (10, 11)])
def test_pieces_of_a_day_stay_together(tmp_path: Path, flaky: tuple[int, int]) -> None:
    kept = np.ones((12, 24 * 60), dtype=bool)
    for begin in range(200, 1200, 240):
        kept[np.array(flaky), begin : begin + 62] = False
    minutes = np.flatnonzero(kept)
    columns = {name: np.random.default_rng(0).uniform(5, 30, len(minutes)) for name in "ab"}
    times = [datetime.datetime(2024, 3, 1) + datetime.timedelta(minutes=int(minute)) for minute in minutes]
    pl.DataFrame({"timestamp": times, **columns}).write_csv(tmp_path / "t.csv")
    data = read_data(tmp_path / "t.csv")
    rows = [sum(len(one.speeds) for one in data.sets[name]) for name in ("train", "validation", "test")]
    ends = np.cumsum(kept.sum(axis=1))[[7, 9, 11]]
    assert np.cumsum(rows).tolist() == ends.tolist(), "eight days, two and two"


def test_islands_of_one_day_are_no_days(tmp_path: Path) -> None:
    minutes = np.concatenate([*(150 * i + np.arange(12) for i in range(9)), np.arange(1440, 3 * 1440)])
    columns = {name: np.random.default_rng(0).uniform(5, 30, len(minutes)) for name in "ab"}
    pl.DataFrame({"minute": minutes, **columns}).write_csv(tmp_path / "t.csv")
    data = read_data(tmp_path / "t.csv")
    rows = np.array([sum(len(one.speeds) for one in data.sets[name]) for name in ("train", "validation", "test")])
    assert np.allclose(rows / len(minutes), (0.7, 0.1, 0.2), atol=0.01)


def test_skipped_rows_are_missing_values_and_a_long_hole_begins_anew(tmp_path: Path) -> None:
    speeds, minutes = road_speeds(300, 3), np.arange(300)
    kept = np.concatenate([np.arange(100), np.arange(103, 200), np.arange(270, 300)])
    table = {"minute": minutes[kept]} | {f"s{i}": speeds[kept, i] for i in range(3)}
    pl.DataFrame(table).write_parquet(tmp_path / "t.parquet")
    data = read_data(tmp_path / "t.parquet")
    whole = [one for name in ("train", "validation", "test") for one in data.sets[name]]
    assert sum(len(one.speeds) for one in whole) == 200 + 30
    assert sum(int(np.isnan(one.speeds).all(axis=1).sum()) for one in whole) == 3


def test_a_number_may_stand_for_missing(tmp_path: Path) -> None:
    speeds = road_speeds(200, 3)
    speeds[::10, 1] = 0.0
    data = read_data(write_csv(tmp_path / "t.csv", speeds), Format(missing_value=0.0))
    assert sum(int(np.isnan(one.speeds).sum()) for some in data.sets.values() for one in some) == 20


def test_a_folder_of_days(tmp_path: Path) -> None:
    data = read_data(write_folder(tmp_path / "freeway", days=4, rows=60))
    assert {name: len(some) for name, some in data.sets.items()} == {"train": 3, "validation": 1, "easy": 1, "hard": 2}
    assert data.lag_min == 3.0
    assert data.measured_sets == ("easy", "hard")
    assert data.sets["hard"][0].truth is not None


def bad_tables() -> dict[str, tuple[dict[str, object], Format, str]]:
    good = road_speeds(200, 3)
    columns = {f"s{i}": good[:, i] for i in range(3)}
    minutes = np.arange(200)
    holes = np.where(np.arange(200) % 2, NAN, good[:, 1])
    every_5 = [datetime.datetime(2024, 1, 1) + datetime.timedelta(minutes=5 * i) for i in range(200)]
    in_kmh, in_mps = Format("km/h"), Format()

    def but(column: str, row: int, value: float) -> dict[str, object]:
        return columns | {column: np.where(minutes == row, value, good[:, int(column[1])])}

    many = {f"t{i}": good[:, 0] for i in range(30)}
    return {
        "too few rows": ({k: v[:100] for k, v in columns.items()}, in_mps, "at least 120 rows to learn from, got 100"),
        "constant": (columns | {"s1": np.full(200, 25.0)}, in_mps, r"column 's1' is constant \(25 m/s\)"),
        "missing": (columns | {"s1": holes}, in_mps, "column 's1' lacks 50 % of its values, expected at most 30 %"),
        "all missing": (columns | {"s1": [None] * 200}, in_mps, "column 's1' lacks 100 %"),
        "km/h as mph": ({k: v * 3.6 for k, v in columns.items()}, Format("mph"), r"read as mph.*are these .*km/h\?"),
        "km/h as m/s": ({k: v * 3.6 for k, v in columns.items()}, in_mps, r"read as m/s.*are these km/h\?"),
        "mph as m/s": ({k: v * 2.24 for k, v in columns.items()}, in_mps, r"read as m/s.*are these km/h or mph\?"),
        "m/s as km/h": ({k: v / 2 for k, v in columns.items()}, in_kmh, r"read as km/h.*are these m/s"),
        "one in mph": (columns | many | {"s2": good[:, 2] * 2.24}, in_mps, "of column 's2'"),
        "negative": (but("s0", 7, -1.0), in_mps, "'s0' has the speed -1 m/s in row 8"),
        "words": (columns | {"s1": ["fast"] * 200}, in_mps, "expected numbers in column 's1', got 'fast'"),
        "infinite": (but("s1", 3, np.inf), in_mps, "'s1' is infinite in row 4"),
        "backwards": ({"time": minutes[::-1], **columns}, in_mps, "expected times that increase, row 2 does not"),
        "other step": ({"timestamp": every_5, **columns}, Format(step_s=60.0), "every 60 s, got times 300 s apart"),
        "times of day": ({"time": [datetime.time(5, i // 60, i % 60) for i in range(200)], **columns}, in_mps,
            "expected dates with times in column 'time', got times without a date: 05:00:00"),
        "Unix times": ({"timestamp": 1441045320 + 300 * minutes, **columns}, in_mps,
            "got 1441045320; are these seconds or milliseconds since 1970.*--step"),
        "no speeds": ({"time": minutes}, in_mps, "columns of speeds"),
    }  # fmt: skip


@pytest.mark.parametrize("per_s", [1, 1000])
def test_unix_times_are_read_with_the_minutes_between_rows(tmp_path: Path, per_s: int) -> None:
    times = (1441045320 + 300 * np.arange(200)) * per_s
    pl.DataFrame({"timestamp": times, "s": road_speeds(200, 1)[:, 0]}).write_csv(tmp_path / "t.csv")
    assert read_latest(tmp_path / "t.csv", Format(step_s=300.0)).start_s == 1441045320.0


def unix_times(rows: int, per_s: int, seed: int) -> IntArray:
    """Every 5 minutes and up to 20 s later."""
    random = np.random.default_rng(seed)
    return (1756684800 + 300 * np.arange(rows) + random.integers(0, 21, rows)) * per_s + random.integers(0, per_s, rows)


@pytest.mark.parametrize("per_s", [1, 10**3, 10**6, 10**9])
def test_uneven_unix_times_are_those_of_the_rows(tmp_path: Path, per_s: int) -> None:
    speeds, how = road_speeds(3000, 1), Format(step_s=300.0)
    paths = [tmp_path / name for name in ("a.csv", "b.csv")]
    for seed, path in enumerate(paths):
        pl.DataFrame({"timestamp": unix_times(3000, per_s, seed), path.stem: speeds[:, 0]}).write_csv(path)
    grid = read_latest(paths, how)
    assert len(grid.place) == 3000
    assert np.isfinite(grid.speeds).all(), "both files have each step"
    assert grid.last_s == pytest.approx(1756684800 + 300 * 2999, abs=21.0)
    lines = paths[0].read_text().splitlines(keepends=True)
    last_s = []
    for rows in range(2000, 2010):
        paths[0].write_text("".join(lines[: rows + 1]))
        last_s.append(read_latest(paths[0], how).last_s)
    assert np.diff(last_s).tolist() == [300.0] * 9, "a step for each row that is added"


@pytest.mark.parametrize(
    ("every", "message"),
    [
        (301, "expected a row every 300 s, got times 301 s apart"),
        (7, "expected minutes, seconds, .* with rows 5 minutes apart .* rows 7 apart"),
    ],
)
def test_unix_times_of_another_step_are_refused(tmp_path: Path, every: int, message: str) -> None:
    times = 1756684800 + every * np.arange(200)
    pl.DataFrame({"timestamp": times, "s": road_speeds(200, 1)[:, 0]}).write_csv(tmp_path / "t.csv")
    with pytest.raises(InvalidInputError, match=message):
        read_latest(tmp_path / "t.csv", Format(step_s=300.0))


def test_numbers_of_rows_are_times_with_a_step(tmp_path: Path) -> None:
    pl.DataFrame({"index": np.arange(200), "s": road_speeds(200, 1)[:, 0]}).write_csv(tmp_path / "t.csv")
    assert read_latest(tmp_path / "t.csv", Format(step_s=300.0)).last_s == 300.0 * 199


@pytest.mark.parametrize("name", bad_tables())
def test_a_bad_table_is_one_clear_line(name: str, tmp_path: Path) -> None:
    columns, how, message = bad_tables()[name]
    pl.DataFrame(columns).write_parquet(tmp_path / "t.parquet")
    with pytest.raises(InvalidInputError, match=message) as caught:
        read_data(tmp_path / "t.parquet", how)
    assert "\n" not in str(caught.value)
    assert str(tmp_path / "t.parquet") in str(caught.value)


@pytest.mark.parametrize("bad", ["-3", "inf"])
def test_a_bad_speed_is_named_by_its_line_in_the_file(bad: str, tmp_path: Path) -> None:
    times = [
        datetime.datetime(2024, 3, 1) + datetime.timedelta(minutes=minute) for minute in (*range(20), *range(50, 230))
    ]
    lines = ["time,a", *(f"{time},{20 + i % 5}" for i, time in enumerate(times))]
    lines[100] = f"{times[99]},{bad}"
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    for read in (read_data, read_latest):
        with pytest.raises(InvalidInputError, match=r"column 'a' .* in line 101"):
            read(tmp_path / "t.csv")


def test_a_bad_file_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "t.parquet").write_bytes(b"no parquet")
    (tmp_path / "t.xlsx").write_bytes(b"")
    (tmp_path / "empty").mkdir()
    cases = {"t.parquet": "cannot be read", "t.xlsx": "a .csv or .parquet file", "no.csv": "no file or folder"}
    for name, message in (cases | {"empty": "expected a dataset.json"}).items():
        with pytest.raises(InvalidInputError, match=message):
            read_data(tmp_path / name)
    with pytest.raises(UnknownNameError, match="no unit named 'knots'"):
        read_data(tmp_path, Format("knots"))


def test_gaps_are_held_then_taken_back_then_interpolated_along_the_road() -> None:
    history = np.array([[[1, NAN, NAN, 4], [NAN, NAN, 9, 8]]], dtype=np.float32)
    # s0 is held, s2 is taken back from its first value, s1 is silent: the mean of its neighbours, row by row.
    np.testing.assert_allclose(fill(history)[0], [[1, 5, 9, 4], [1, 5, 9, 8]])
    ends = np.array([[[NAN, NAN, 6, NAN]]], dtype=np.float32)
    np.testing.assert_allclose(fill(ends)[0], [[6, 6, 6, 6]])
    with pytest.raises(InvalidInputError, match="at least one measured speed"):
        fill(np.full((1, 8, 3), np.nan, dtype=np.float32))


@given(st.integers(0, 2**31), st.floats(0.0, 0.8))
@settings(max_examples=40, deadline=None)
def test_filling_keeps_every_measured_value_and_leaves_no_gap(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    whole = rng.uniform(0, 30, (4, 8, 5)).astype(np.float32)
    holes = rng.random(whole.shape) < share
    holes[:, 0, 0] = False
    got = fill(np.where(holes, np.float32(np.nan), whole))
    np.testing.assert_array_equal(got[~holes], whole[~holes])
    assert np.isfinite(got).all()
    assert got.min() >= whole[~holes].min() - 1e-4
    assert got.max() <= whole[~holes].max() + 1e-4


def test_windows_are_the_rows_before_and_after() -> None:
    one = road_stretch(30, 4)
    windows = make_windows([one, road_stretch(30, 4, seed=1)], 60.0)
    assert len(windows) == 2 * 20
    np.testing.assert_array_equal(windows.history[3], one.speeds[3:11])
    np.testing.assert_array_equal(windows.target[3], one.speeds[11:14])
    assert windows.time_s[3] == 300 * 60 + 10 * 60
    assert (windows.stretch[:20] == 0).all(), "no window reaches from one stretch into the next"
    with pytest.raises(InvalidInputError, match="expected 11 consecutive rows with values, got at most 10"):
        make_windows([road_stretch(10, 4)], 60.0)


@given(st.integers(0, 2**31), st.integers(12, 28))
@settings(max_examples=20, deadline=None)
def test_later_rows_change_no_earlier_history(seed: int, cut: int) -> None:
    one = road_stretch(30, 4, seed=seed % 1000, missing=0.3)
    later = one.speeds.copy()
    later[cut:] = np.random.default_rng(seed).uniform(0, 30, later[cut:].shape)
    before, after = (make_windows([type(one)("x", 0.0, speeds)], 60.0) for speeds in (one.speeds, later))
    for row in range(7, cut):
        mine, theirs = before.history[before.row == row], after.history[after.row == row]
        if len(mine) and len(theirs):
            np.testing.assert_array_equal(mine, theirs)


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_a_detector_without_a_value_stops_no_forecast_of_the_others(tmp_path: Path, kind: str) -> None:
    times = [datetime.datetime(2026, 3, 2) + datetime.timedelta(minutes=minute) for minute in range(60)]
    table = pl.DataFrame({"time": times, "a": road_speeds(60, 1)[:, 0], "dead": [None] * 60, "b": [20.0, 21.0] * 30})
    path = tmp_path / f"t.{kind}"
    table.write_csv(path) if kind == "csv" else table.cast({"dead": pl.Float64}).write_parquet(path)
    grid = read_latest(path)
    assert grid.names == ("a", "dead", "b")
    forecast = forecast_now(Persistence(3), grid)
    np.testing.assert_allclose(forecast.ahead[:, 1], forecast.ahead[:, [0, 2]].mean(axis=1), atol=1e-3)


def test_lines_that_end_in_a_comma_have_no_other_column(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("minute,a,\n" + "".join(f"{minute},2{minute % 5},\n" for minute in range(60)))
    assert read_latest(tmp_path / "t.csv").names == ("a",)


def test_a_word_among_speeds_is_named_by_its_line(tmp_path: Path) -> None:
    lines = ["minute,a,b", *(f"{minute},2{minute % 5},20.5" for minute in range(60))]
    lines[9] = "8,N/A,20.5"
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    assert np.argwhere(np.isnan(read_latest(tmp_path / "t.csv").speeds)).tolist() == [[8, 0]]
    lines[19] = "18,ERR,20.5"
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(InvalidInputError, match="expected numbers in column 'a', got 'ERR' in line 20"):
        read_latest(tmp_path / "t.csv")


@pytest.mark.parametrize("end", ["\n", ""])
def test_names_in_quotes_are_those_of_the_columns(tmp_path: Path, end: str) -> None:
    rows = [f"{minute},20.5,30.5" for minute in range(60)]
    (tmp_path / "t.csv").write_text("\n".join(['minute,A 1 (süd),"B, ""2"""', *rows]) + end)
    grid = read_latest(tmp_path / "t.csv")
    assert grid.names == ("A 1 (süd)", 'B, "2"')
    assert grid.steps == 60


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ("Zeit;Geschwindigkeit\n02.03.2026 00:00;108,9\n02.03.2026 00:05;109,3\n", "';'"),
        ("interval_begin;interval_end;interval_id;interval_speed\n28800.00;29100.00;det0;30.24\n", "';'"),
        ("time\tspeed\n2026-03-02 00:00\t30.24\n", "a tab"),
    ],
)
def test_columns_that_no_comma_separates_are_told(tmp_path: Path, lines: str, told: str) -> None:
    (tmp_path / "t.csv").write_text(lines)
    for read in (read_data, read_latest):
        with pytest.raises(InvalidInputError, match=f"expected columns separated by commas, got {told} in line 1"):
            read(tmp_path / "t.csv")


def test_a_semicolon_in_a_name_separates_nothing(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("speed; m/s\n" + "20.5\n" * 60)
    assert read_latest(tmp_path / "t.csv").names == ("speed; m/s",)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_the_encoding_of_excels_unicode_text_is_named(tmp_path: Path, encoding: str) -> None:
    for separator in ",\t":
        lines = [separator.join(("time", "speed")), *(f"{minute}{separator}2{minute % 5}" for minute in range(200))]
        (tmp_path / "t.csv").write_bytes("\r\n".join(lines).encode(encoding))
        for growing in (False, True):
            with pytest.raises(InvalidInputError, match=r"expected text in UTF-8, got UTF-16 .*; save it as CSV UTF-8"):
                read_latest(tmp_path / "t.csv", Format(growing=growing))


@pytest.mark.parametrize(
    ("header", "row", "told"),
    [
        ("date,time,speed", "2026-03-02,00:{0:02}:00,2{0}.5", "times in column 'time', beside 'date'"),
        ("date,time,speed", "02.03.2026,00:{0:02},2{0}.5", "times in column 'time', beside 'date'"),
        ("id,time,speed", "6005,2026-03-02 00:{0:02}:00,2{0}.5", "times in column 'time', after 'id'"),
        ("id,time,speed", "north,2026-03-02T00:{0:02}:00+01:00,2{0}.5", "times in column 'time', after 'id'"),
        ("id,time,speed", "north,02.03.2026 00:{0:02},2{0}.5", "times in column 'time', after 'id'"),
    ],
)
def test_one_column_of_whole_times_comes_first(tmp_path: Path, header: str, row: str, told: str) -> None:
    (tmp_path / "t.csv").write_text("\n".join([header, *(row.format(minute) for minute in range(60))]) + "\n")
    for read in (read_data, read_latest):
        with pytest.raises(InvalidInputError, match=f"expected one column of whole times.* first.*, got {told}"):
            read(tmp_path / "t.csv")
