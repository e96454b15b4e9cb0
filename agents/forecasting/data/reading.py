"""Reading speed tables: CSV, Parquet, or a folder of days; with a one-line message for each error of a file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from dohyo.agents.forecasting.data.speed_table import (
    DAY_S,
    UNITS,
    SpeedData,
    Stretch,
    check_speeds,
    hold_out_days,
    split_table,
)
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

TIME_NAMES = ("", "time", "timestamp", "datetime", "date", "minute", "minutes", "t", "index", "unnamed: 0")
FOLDER_SETS = ("train", "easy", "hard")
LONGEST_GAP_ROWS = 60
"""Gap in time after which a new stretch begins, s."""
NULLS = ["", "nan", "NaN", "NA", "null", "None", "-"]


@dataclass(frozen=True, slots=True)
class Format:
    """Settings for reading a table.

    Attributes:
        unit: Of its speeds, a name of `data.UNITS`.
        step_s: Seconds between rows; None: from its column of times, or a minute without one.
        max_missing: Share of a column that may be missing.
        missing_value: A number that stands for a missing value, such as 0 in METR-LA.
    """

    unit: str = "m/s"
    step_s: float | None = None
    max_missing: float = 0.3
    missing_value: float | None = None


def read_data(path: Path, how: Format | None = None) -> SpeedData:
    """A folder of days or one table.

    Raises:
        InvalidInputError: See the module.
    """
    how = how or Format()
    if how.unit not in UNITS:
        raise UnknownNameError("unit", how.unit, UNITS)
    if how.step_s is not None and not how.step_s > 0.0:
        raise InvalidInputError(f"expected a time step above 0 s, got {how.step_s:g}")
    if not path.exists():
        raise InvalidInputError(f"no file or folder '{path}'")
    return _read_folder(path, how) if path.is_dir() else _read_table(path, how)


def read_set(path: Path, name: str) -> list[Stretch]:
    """The days of one set of a folder, in the order of their numbers.

    Raises:
        InvalidInputError: There is no day, or one is damaged.
    """
    _dataset_facts(path / "dataset.json")
    days = [_read_day(file, Format())[0] for file in sorted((path / name).glob("*.parquet"))]
    if not days:
        raise InvalidInputError(f"'{path}': expected days in '{path / name}', found no *.parquet")
    return days


def _read_folder(path: Path, how: Format) -> SpeedData:
    facts = _dataset_facts(path / "dataset.json")
    sets: dict[str, Sequence[Stretch]] = {}
    segments: tuple[str, ...] = ()
    for name in FOLDER_SETS:
        days = []
        for file in sorted((path / name).glob("*.parquet")):
            day, columns = _read_day(file, how)
            if segments and columns != segments:
                raise InvalidInputError(f"'{file}': expected the columns {_few(segments)}, got {_few(columns)}")
            segments = columns
            days.append(day)
        if days:
            sets[name] = days
    if "train" not in sets:
        raise InvalidInputError(f"'{path}': expected days in '{path / 'train'}', found no *.parquet")
    everything = [day for days in sets.values() for day in days]
    check_speeds(everything, segments, str(path), how.unit, how.max_missing)
    train, validation = hold_out_days(sets["train"])
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
    table = _frame(path)
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


def _read_table(path: Path, how: Format) -> SpeedData:
    table = _frame(path)
    time = next((name for name in table.columns[:1] if _is_time(table[name])), None)
    names = tuple(name for name in table.columns if name != time)
    if not names or not len(table):
        raise InvalidInputError(
            f"'{path}': expected rows of times and columns of speeds, got {len(table)} rows, {len(names)} columns"
        )
    speeds = _speeds(path, table, names, how)
    clock, step_s = _clock(path, table[time] if time is not None else None, len(table), how.step_s)
    stretches = _stretches(path, clock, step_s, speeds)
    whole = [Stretch(path.stem, 0.0, speeds)]
    try:
        sets = split_table(stretches, step_s)
    except InvalidInputError as error:
        raise InvalidInputError(f"'{path}': {error}") from error
    check_speeds(whole, names, str(path), how.unit, how.max_missing)
    return SpeedData(names, step_s, sets, 0.0, str(path))


def _frame(path: Path) -> pl.DataFrame:
    readers = {
        ".csv": lambda: pl.read_csv(path, infer_schema_length=None, null_values=NULLS, try_parse_dates=True),
        ".parquet": lambda: pl.read_parquet(path),
    }
    if path.suffix.lower() not in readers:
        raise InvalidInputError(f"'{path}': expected a .csv or .parquet file")
    try:
        return readers[path.suffix.lower()]()
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InvalidInputError(f"'{path}' cannot be read: {str(error).splitlines()[0]}") from error


def _is_time(column: pl.Series) -> bool:
    """Whether a first column holds times: dates, or a name that says so."""
    return column.dtype.is_temporal() or column.name.strip().lower() in TIME_NAMES


def _speeds(path: Path, table: pl.DataFrame, names: Sequence[str], how: Format) -> Float32Array:
    speeds = _numbers(path, table, names)
    if how.missing_value is not None:
        speeds = np.where(speeds == np.float32(how.missing_value), np.float32(np.nan), speeds)
    return np.asarray(speeds * np.float32(UNITS[how.unit]), dtype=np.float32)


def _numbers(path: Path, table: pl.DataFrame, names: Sequence[str]) -> Float32Array:
    wrong = [name for name in names if not (table[name].dtype.is_numeric() or table[name].dtype == pl.Null)]
    if wrong:
        value = table[wrong[0]].drop_nulls().to_list()[:1]
        raise InvalidInputError(
            f"'{path}': expected numbers in column '{wrong[0]}', got {value[0] if value else '?'!r}"
        )
    out = table.select(pl.col(list(names)).cast(pl.Float32)).to_numpy().astype(np.float32)
    if np.isinf(out).any():
        row, column = np.argwhere(np.isinf(out))[0]
        raise InvalidInputError(f"'{path}': column '{names[column]}' is infinite in row {row + 1}")
    return out


def _clock(path: Path, column: pl.Series | None, rows: int, step_s: float | None) -> tuple[FloatArray, float]:
    """Seconds of each row, and of a step; a bare number counts minutes."""
    if column is None:
        step_s = step_s or 60.0
        return np.arange(rows, dtype=np.float64) * step_s, step_s
    if column.null_count():
        raise InvalidInputError(f"'{path}': the time is missing in row {int(column.is_null().arg_max() or 0) + 1}")
    if column.dtype == pl.String:
        column = _parsed(path, column)
    if column.dtype.is_temporal():
        time_s = np.asarray(column.cast(pl.Datetime("us")).cast(pl.Int64).to_numpy() / 1e6, dtype=np.float64)
    elif step_s is not None:
        time_s = column.to_numpy().astype(np.float64)
        steps = np.diff(time_s)
        time_s = time_s * (step_s / float(np.median(steps)) if len(steps) and np.median(steps) > 0 else 1.0)
    else:
        time_s = 60.0 * column.to_numpy().astype(np.float64)
    steps = np.diff(time_s)
    if len(steps) and steps.min() <= 0.0:
        raise InvalidInputError(f"'{path}': expected times that increase, row {int(steps.argmin()) + 2} does not")
    usual = float(np.median(steps)) if len(steps) else 60.0
    if step_s is not None and abs(usual - step_s) > 1e-3 * step_s:
        raise InvalidInputError(f"'{path}': expected a row every {step_s:g} s, got times {usual:g} s apart")
    return np.asarray(time_s, dtype=np.float64), usual


def _parsed(path: Path, column: pl.Series) -> pl.Series:
    try:
        return column.str.to_datetime(strict=True)
    except pl.exceptions.PolarsError as error:
        raise InvalidInputError(f"'{path}': '{column[0]}' in column '{column.name}' is no time") from error


def _stretches(path: Path, time_s: FloatArray, step_s: float, speeds: Float32Array) -> list[Stretch]:
    """Rows at equal steps, a new stretch each day; skipped rows are missing values, long gaps begin a new one."""
    place = np.round((time_s - time_s[0]) / step_s).astype(int)
    off = np.abs((time_s - time_s[0]) / step_s - place)
    if off.max() > 0.25 or (np.diff(place) < 1).any():
        row = int(off.argmax()) + 1 if off.max() > 0.25 else int(np.diff(place).argmin()) + 2
        raise InvalidInputError(f"'{path}': expected a row every {step_s:g} s, got row {row} between two")
    day = np.floor_divide(time_s, DAY_S).astype(int)
    hole = np.diff(place) > LONGEST_GAP_ROWS
    starts = np.flatnonzero(np.concatenate([[True], hole | (np.diff(day) > 0)]))
    out = []
    for begin, end in zip(starts, [*starts[1:], len(time_s)], strict=True):
        even = np.full((place[end - 1] - place[begin] + 1, speeds.shape[1]), np.nan, dtype=np.float32)
        even[place[begin:end] - place[begin]] = speeds[begin:end]
        out.append(Stretch(f"{path.stem}:{begin + 1}", float(time_s[begin] % DAY_S), even))
    return out


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (f", ... ({len(names)})" if len(names) > 3 else "")
