"""Reading speed tables: CSV, Parquet, or a folder of days; with a one-line message for each error of a file."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from dohyo.agents.forecasting.data import clock_changes
from dohyo.agents.forecasting.data.bare_times import seconds
from dohyo.agents.forecasting.data.column_checks import check_names, segments_note, slow_notes
from dohyo.agents.forecasting.data.csv_table import read_csv, whole_lines
from dohyo.agents.forecasting.data.dates import is_numeric, year_first
from dohyo.agents.forecasting.data.grid import Grid, Rows, on_grid
from dohyo.agents.forecasting.data.no_data import no_data_notes
from dohyo.agents.forecasting.data.speed_table import (
    DAY_S,
    UNITS,
    SpeedData,
    Stretch,
    check_speeds,
    check_values,
    hold_out_days,
    split_table,
)
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

TIME_NAMES = ("", "time", "timestamp", "datetime", "date", "minute", "minutes", "t", "index", "unnamed: 0")
MEASURED_SETS = ("easy", "hard")


@dataclass(frozen=True, slots=True)
class Format:
    """Settings for reading a table.

    Attributes:
        unit: Of its speeds, a name of `data.UNITS`.
        step_s: Seconds between rows; None: from its column of times, or a minute without one.
        max_missing: Share of a column that may be missing.
        missing_value: A number that stands for a missing value, such as 0 in METR-LA.
        tolerance: Largest distance of a row from its step, in steps.
        resample_s: New step in seconds, with means over the rows within; None: the table's own.
        trust_unit: Whether to accept speeds that are implausible in the unit, and names of other quantities.
        growing: Whether a line without an end may still be being written; else only one that lacks columns.
        day_first: Whether dates such as 03/04/2026 begin with the day; None: decided by all dates, see `dates`.
    """

    unit: str = "m/s"
    step_s: float | None = None
    max_missing: float = 0.3
    missing_value: float | None = None
    tolerance: float = 0.5
    resample_s: float | None = None
    trust_unit: bool = False
    growing: bool = False
    day_first: bool | None = None


def read_data(path: Path | Sequence[Path], how: Format | None = None, learn: str = "train") -> SpeedData:
    """A folder of days, one table, or several tables of one road.

    Args:
        path: Of the folder or the tables.
        how: Settings for reading.
        learn: Days of a folder to train on and to validate with, such as its congested "mornings".

    Raises:
        InvalidInputError: See the module.
    """
    how = how or Format()
    paths = _checked(path, how)
    if paths[0].is_dir():
        return _read_folder(paths[0], how, learn)
    grid, source = _read_grid(paths, how), str(paths[0])
    stretches = grid.stretches(paths[0].stem)
    try:
        sets = split_table(stretches, grid.step_s)
    except InvalidInputError as error:
        raise InvalidInputError(f"'{source}': {error}") from error
    check_speeds(stretches, grid.names, source, how.unit, how.max_missing, how.trust_unit)
    speeds = np.concatenate([one.speeds for one in stretches])
    slow = () if how.trust_unit else slow_notes(speeds, grid.names, how.unit)
    notes = (*grid.notes, segments_note(grid.names), *slow)
    missing = float(np.isnan(speeds).mean())
    return SpeedData(grid.names, grid.step_s, sets, 0.0, source, missing, notes, grid.named_by_file)


def read_latest(path: Path | Sequence[Path], how: Format | None = None) -> Grid:
    """Complete steps of one or several tables up to now, however few, see `Grid.complete`.

    An incomplete last line of a growing file is left out.

    Raises:
        InvalidInputError: See the module; the shares of missing values are not checked.
    """
    how = how or Format()
    paths = _checked(path, how)
    if paths[0].is_dir():
        raise InvalidInputError(f"'{paths[0]}': expected a table that grows, got a folder of days")
    grid = _read_grid(paths, how).arrived()
    check_values([Stretch(paths[0].stem, 0.0, grid.speeds)], grid.names, str(paths[0]), how.unit, how.trust_unit)
    return grid


def _checked(path: Path | Sequence[Path], how: Format) -> list[Path]:
    """Paths that exist, for a format that is possible."""
    paths = [path] if isinstance(path, Path) else list(path)
    if how.unit not in UNITS:
        raise UnknownNameError("unit", how.unit, UNITS)
    for name, value in (("time step", how.step_s), ("resampling step", how.resample_s)):
        if value is not None and not value > 0.0:
            raise InvalidInputError(f"expected a {name} above 0 s, got {value:g}")
    for one in paths:
        if not one.exists():
            raise InvalidInputError(f"no file or folder '{one}'")
        if one.is_dir() and len(paths) > 1:
            raise InvalidInputError(f"'{one}': expected one folder or several tables, got {len(paths)} paths")
    return paths


def read_set(path: Path, name: str) -> list[Stretch]:
    """The days of one set of a folder, in the order of their numbers.

    Raises:
        InvalidInputError: There is no day, or one is damaged.
    """
    _dataset_facts(path / "dataset.json")
    days = [read_day(file) for file in sorted((path / name).glob("*.parquet"))]
    if not days:
        raise InvalidInputError(f"'{path}': expected days in '{path / name}', found no *.parquet")
    return days


def read_day(path: Path) -> Stretch:
    """One day of a folder of days, in m/s.

    Raises:
        InvalidInputError: It is missing or damaged.
    """
    return _read_day(path, Format())[0]


def _read_folder(path: Path, how: Format, learn: str) -> SpeedData:
    facts = _dataset_facts(path / "dataset.json")
    sets: dict[str, Sequence[Stretch]] = {}
    segments: tuple[str, ...] = ()
    for name in (learn, *MEASURED_SETS):
        days = []
        for file in sorted((path / name).glob("*.parquet")):
            day, columns = _read_day(file, how)
            if segments and columns != segments:
                raise InvalidInputError(f"'{file}': expected the columns {_few(segments)}, got {_few(columns)}")
            segments = columns
            days.append(day)
        if days:
            sets[name] = days
    if learn not in sets:
        others = sorted({file.parent.name for file in path.glob("*/*.parquet")} - {learn, *MEASURED_SETS})
        hint = f"; learn from other days of it: --learn {others[0]}" if others else ""
        raise InvalidInputError(f"'{path}': expected days in '{path / learn}', found no *.parquet{hint}")
    everything = [day for days in sets.values() for day in days]
    check_speeds(everything, segments, str(path), how.unit, how.max_missing, how.trust_unit)
    train, validation = hold_out_days(sets.pop(learn))
    step_s = float(facts.get("step_s", facts.get("time_step_s", 60.0)))
    lag = float(facts.get("lag_min", facts.get("lag_minutes", 0.0)) or 0.0)
    return SpeedData(segments, step_s, {**sets, "train": train, "validation": validation}, lag, str(path))


def _dataset_facts(path: Path) -> dict[str, Any]:
    try:
        facts = json.loads(path.read_text())
    except FileNotFoundError as error:
        raise InvalidInputError(f"'{path.parent}': expected a dataset.json in the folder") from error
    except (OSError, ValueError) as error:
        raise InvalidInputError(f"'{path}' cannot be read: {error}") from error
    if not isinstance(facts, dict):
        raise InvalidInputError(f"'{path}': expected a JSON object, got {type(facts).__name__}")
    unit = facts.get("units", "m/s")
    if unit != "m/s":
        raise InvalidInputError(f"'{path}': expected units \"m/s\", got {unit!r}")
    return facts


def _read_day(path: Path, how: Format) -> tuple[Stretch, tuple[str, ...]]:
    table, _ = _frame(path, how)
    names = tuple(sorted(name for name in table.columns if name.startswith("segment_")))
    if not names or "minute" not in table.columns:
        raise InvalidInputError(f"'{path}': expected the columns minute, segment_00, ..., got {_few(table.columns)}")
    minute = table["minute"].to_numpy().astype(np.float64)
    if len(minute) > 1 and not np.allclose(np.diff(minute), np.diff(minute)[0]):
        raise InvalidInputError(f"'{path}': expected minutes at equal steps, got {minute[:4].tolist()}, ...")
    truths = [name.replace("segment_", "truth_") for name in names]
    truth = _numbers(path, table, truths) if set(truths) <= set(table.columns) else None
    start_s = 60.0 * float(minute[0]) % DAY_S if len(minute) else 0.0
    name = f"{path.parent.name}/{path.stem}"
    return Stretch(name, start_s, _speeds(path, table, names, how), truth), names


def _read_grid(paths: Sequence[Path], how: Format) -> Grid:
    """All tables on one grid."""
    files = [_read_rows(path, how) for path in paths]
    grid = on_grid(files, how.step_s, how.tolerance, how.resample_s)
    reported = [column for one in files for column in one.speeds.T]
    return replace(grid, notes=(*grid.notes, *no_data_notes(reported, grid.names, how.unit)))


def _read_rows(path: Path, how: Format) -> Rows:
    table, lines = _frame(path, how)
    time = next((name for name in table.columns[:1] if _is_time(table[name])), None)
    names = tuple(name for name in table.columns if name != time and not _is_end(table[name]))
    if not names or not len(table):
        raise InvalidInputError(
            f"'{path}': expected rows of times and columns of speeds, got {len(table)} rows, {len(names)} columns"
        )
    _check_first(path, table, time)
    times, notes = (None, ()) if time is None else _times(path, table[time], how)
    clock = _clock(path, times, len(table), how)
    offset_s = None if times is None else _offset_s(lines, times)
    local = times is not None and _is_local(times)
    if local:
        notes += clock_changes.notes_on_hours(clock)
    notes += check_names(names, str(path), how.trust_unit)
    return Rows(str(path), clock, names, _speeds(path, table, names, how), offset_s, notes, local)


def _frame(path: Path, how: Format) -> tuple[pl.DataFrame, bytes]:
    """A table, and its lines if it is CSV: both of one reading, since another program may replace the file."""
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".parquet"):
        raise InvalidInputError(f"'{path}': expected a .csv or .parquet file")
    try:
        if suffix == ".parquet":
            return pl.read_parquet(path), b""
        lines = whole_lines(path, how.growing)
        return read_csv(path, lines), lines
    except (pl.exceptions.PolarsError, OSError, csv.Error) as error:
        raise InvalidInputError(f"'{path}' cannot be read: {str(error).splitlines()[0]}") from error


def _is_time(column: pl.Series) -> bool:
    """Whether a first column holds times: dates, or a name that says so."""
    in_numbers = column.dtype == pl.String and len(column) > 0 and is_numeric(column[0] or "")
    return column.dtype.is_temporal() or in_numbers or column.name.strip().lower() in TIME_NAMES


def _check_first(path: Path, table: pl.DataFrame, time: str | None) -> None:
    """Refuses times in another column than the first, such as a time of day beside its date."""
    later = [name for name in table.columns[1:] if _holds_times(table[name])]
    if later:
        where = f"after '{table.columns[0]}'" if time is None else f"beside '{time}'"
        raise InvalidInputError(
            f"'{path}': expected one column of whole times, such as 2026-03-02 00:05, first and speeds after it, got "
            f"times in column '{later[0]}', {where}"
        )


def _holds_times(column: pl.Series) -> bool:
    """Whether a column begins with a date or a time of day; one without a value holds nothing."""
    if column.null_count() == len(column):
        return False
    if column.dtype != pl.String:
        return column.dtype.is_temporal()
    first = str(column.drop_nulls()[0])
    return is_numeric(first) or bool(re.match(r"\s*\d{1,2}:\d{2}", first))


def _is_end(column: pl.Series) -> bool:
    """Whether a column is none: lines that end in a comma have one without a name and without values."""
    return not column.name.strip() and column.null_count() == len(column)


def _place(path: Path, row: int) -> str:
    """Name of a row, as editors count the lines of a file."""
    return f"line {row + 2}" if path.suffix.lower() == ".csv" else f"row {row + 1}"


def _speeds(path: Path, table: pl.DataFrame, names: Sequence[str], how: Format) -> Float32Array:
    speeds = _numbers(path, table, names)
    if how.missing_value is not None:
        speeds = np.where(speeds == np.float32(how.missing_value), np.float32(np.nan), speeds)
    if (speeds < 0.0).any():
        row, column = np.argwhere(speeds < 0.0)[0]
        raise InvalidInputError(
            f"'{path}': column '{names[column]}' has the speed {speeds[row, column]:.4g} {how.unit} in "
            f"{_place(path, row)}, expected 0 or more"
        )
    return np.asarray(speeds * np.float32(UNITS[how.unit]), dtype=np.float32)


def _numbers(path: Path, table: pl.DataFrame, names: Sequence[str]) -> Float32Array:
    out = table.select([_number_column(path, table[name]) for name in names]).to_numpy().astype(np.float32)
    if np.isinf(out).any():
        row, column = np.argwhere(np.isinf(out))[0]
        raise InvalidInputError(f"'{path}': column '{names[column]}' is infinite in {_place(path, row)}")
    return out


def _number_column(path: Path, column: pl.Series) -> pl.Series:
    """A column as numbers; one without a value, such as that of a broken detector, has any type."""
    is_known = column.is_not_null()
    if not column.dtype.is_numeric() and is_known.any():
        numbers = (
            column.cast(pl.Float64, strict=False) if column.dtype == pl.String else pl.Series([None] * len(column))
        )
        wrong = is_known & numbers.is_null()
        if wrong.any():
            row = int(wrong.arg_max() or 0)
            raise InvalidInputError(
                f"'{path}': expected numbers in column '{column.name}', got {column[row]!r} in {_place(path, row)}"
            )
        column = numbers
    return column.cast(pl.Float32)


def _clock(path: Path, column: pl.Series | None, rows: int, how: Format) -> FloatArray:
    """(R,) seconds of each row; a bare number counts minutes."""
    step_s = how.step_s
    if column is None:
        return np.arange(rows, dtype=np.float64) * (step_s or 60.0)
    if column.dtype in (pl.Time, pl.Duration):
        raise InvalidInputError(
            f"'{path}': expected dates with times in column '{column.name}', got times without a date: {column[0]}"
        )
    if column.dtype.is_temporal():
        time_s = np.asarray(column.cast(pl.Datetime("us")).cast(pl.Int64).to_numpy() / 1e6, dtype=np.float64)
    else:
        time_s = seconds(path, column.name, column.to_numpy().astype(np.float64), step_s)
    steps = np.diff(time_s)
    if len(steps) and steps.min() < 0.0:
        raise InvalidInputError(
            f"'{path}': expected times that increase, {_place(path, int(steps.argmin()) + 1)} does not"
            f"{clock_changes.advice(time_s, _is_local(column))}"
        )
    return np.asarray(time_s, dtype=np.float64)


def _is_local(column: pl.Series) -> bool:
    """Whether times are dates without a zone."""
    zone = column.dtype.time_zone if isinstance(column.dtype, pl.Datetime) else None
    return column.dtype.is_temporal() and zone is None


def _offset_s(lines: bytes, column: pl.Series) -> float | None:
    """How far the clock of a table's last time is ahead of UTC, s; None of times without a zone."""
    if not isinstance(column.dtype, pl.Datetime) or column.dtype.time_zone is None:
        return None
    last = column[-1]
    if lines:  # of CSV, whose offset polars does not keep
        line = lines.rstrip().rpartition(b"\n")[2]
        try:
            last = datetime.fromisoformat(line.partition(b",")[0].strip(b'" ').decode(errors="replace"))
        except ValueError:
            return 0.0
    return (last.utcoffset() or timedelta()).total_seconds()


def _times(path: Path, column: pl.Series, how: Format) -> tuple[pl.Series, tuple[str, ...]]:
    """A column of times without texts, and what was decided about them."""
    if column.null_count():
        raise InvalidInputError(
            f"'{path}': the time is missing in {_place(path, int(column.is_null().arg_max() or 0))}"
        )
    if column.dtype != pl.String:
        return column, ()
    if not is_numeric(column[0]):
        return _parsed(path, column, column), ()
    try:
        texts, note = year_first(column, how.day_first)
    except InvalidInputError as error:
        raise InvalidInputError(f"'{path}', column '{column.name}': {error}") from error
    return _parsed(path, column, texts), (note,)


def _parsed(path: Path, column: pl.Series, texts: pl.Series) -> pl.Series:
    """Times of texts, which are a column as it is or in another order."""
    try:
        times = texts.str.to_datetime(strict=False)
    except pl.exceptions.PolarsError:
        times = pl.Series([None] * len(texts), dtype=pl.Datetime)
    if times.null_count():
        row = int(times.is_null().arg_max() or 0)
        raise InvalidInputError(f"'{path}': '{column[row]}' in column '{column.name}', {_place(path, row)}, is no time")
    return times


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (f", ... ({len(names)})" if len(names) > 3 else "")
