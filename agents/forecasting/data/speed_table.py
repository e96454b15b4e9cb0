"""Speed tables: rows are times, columns are segments or sensors; one table, or a folder of days.

A folder has `dataset.json` and one Parquet file per day in `train/`, `easy/` and `hard/`, with the columns `minute`,
`segment_00`, ... and, where the simulation knows them, `truth_00`, ... A table is one CSV or Parquet file, from
anywhere. Both become `Stretch`es: rows at equal steps, in m/s, NaN where nothing was measured. Misleading data are
refused: by `reading.py` for errors of a file, and by `check_speeds` for errors of values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

UNITS = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704}
"""Metres per second in one unit."""
DAY_S = 86400
MIN_ROWS = 120
"""Fewest rows of a table to learn from."""
MIN_DAYS = 10
"""Fewest days of a table that is split by day."""
FREE_MPS = (5.0, 42.0)
"""Range of the 95 % quantile of speeds: an alley has 18 km/h, a motorway without limit 151."""
STANDS_STILL_MPS = 1e-3
SHARES = (0.7, 0.1, 0.2)
"""Shares of a single table to train, to validate and to test, in time's order."""
SETS = ("train", "validation", "easy", "hard", "test")


@dataclass(frozen=True)
class Stretch:
    """Rows without interruption, mostly one day.

    Attributes:
        name: Source.
        start_s: Time of day of the first row.
        speeds: (T, N) measured, m/s, NaN where missing.
        truth: (T, N) of all vehicles, m/s, if known.
        day: Number of its day, counted from any; stretches of one table with the same one are parts of a day.
    """

    name: str
    start_s: float
    speeds: Float32Array
    truth: Float32Array | None = None
    day: int = 0

    def part(self, begin: int, end: int, step_s: float) -> Stretch:
        """Rows [begin, end), with their own time of day."""
        truth = None if self.truth is None else self.truth[begin:end]
        return Stretch(self.name, (self.start_s + begin * step_s) % DAY_S, self.speeds[begin:end], truth, self.day)

    def chosen(self, columns: Sequence[int]) -> Stretch:
        """Columns by their numbers."""
        truth = None if self.truth is None else self.truth[:, columns]
        return replace(self, speeds=self.speeds[:, columns], truth=truth)


@dataclass(frozen=True)
class SpeedData:
    """Data for training and evaluation of forecasters.

    Attributes:
        segments: Names of the N columns, in the order in which they lie along the road.
        step_s: Seconds between two rows.
        sets: Stretches by set: `train` and `validation`, and `easy` and `hard` of a folder or `test` of a table.
        lag_min: Largest delay of the feed, minutes.
        source: Path.
        missing: Share of missing values, by the rule of `grid`.
        notes: What was done to the rows, one sentence each.
        named_by_file: Whether names of columns are those of their files, since several files have the same columns.
    """

    segments: tuple[str, ...]
    step_s: float
    sets: Mapping[str, Sequence[Stretch]] = field(default_factory=dict)
    lag_min: float = 0.0
    source: str = ""
    missing: float = 0.0
    notes: tuple[str, ...] = ()
    named_by_file: bool = False

    def chosen(self, columns: Sequence[int], note: str) -> SpeedData:
        """Columns by their numbers, and a note about them."""
        names = tuple(self.segments[column] for column in columns)
        sets = {name: [one.chosen(columns) for one in some] for name, some in self.sets.items()}
        return replace(self, segments=names, sets=sets, notes=(*self.notes, note))

    def stretches(self, name: str) -> Sequence[Stretch]:
        """Stretches of one set.

        Raises:
            UnknownNameError: There is no such set.
        """
        if name not in self.sets:
            raise UnknownNameError("set", name, self.sets)
        return self.sets[name]

    @property
    def measured_sets(self) -> tuple[str, ...]:
        """Sets for evaluation."""
        return tuple(name for name in ("easy", "hard", "test") if name in self.sets)


def split_table(stretches: Sequence[Stretch], step_s: float) -> dict[str, list[Stretch]]:
    """Train, validation and test, one after the other in time: whole days where there are ten, else rows.

    Raises:
        InvalidInputError: There are too few rows.
    """
    rows = sum(len(one.speeds) for one in stretches)
    if rows < MIN_ROWS:
        raise InvalidInputError(f"expected at least {MIN_ROWS} rows to learn from, got {rows}")
    names = ("train", "validation", "test")
    ends = np.cumsum(SHARES)
    days = list(dict.fromkeys(one.day for one in stretches))
    if len(days) >= MIN_DAYS:
        cuts = np.round(ends * len(days)).astype(int)
        shares = {name: days[begin:end] for name, begin, end in zip(names, (0, *cuts), cuts, strict=False)}
        return {name: [one for one in stretches if one.day in share] for name, share in shares.items()}
    sets: dict[str, list[Stretch]] = {name: [] for name in names}
    cuts, past = np.round(ends * rows).astype(int), 0
    for one in stretches:
        for name, begin, end in zip(names, (0, *cuts), cuts, strict=False):
            first, last = max(begin - past, 0), min(end - past, len(one.speeds))
            if first < last:
                sets[name].append(one.part(first, last, step_s))
        past += len(one.speeds)
    return sets


def hold_out_days(days: Sequence[Stretch], share: float = SHARES[1]) -> tuple[list[Stretch], list[Stretch]]:
    """The days to train on, and the last ones to validate with: at least one of each.

    Raises:
        InvalidInputError: There is one day only.
    """
    if len(days) < 2:
        raise InvalidInputError(f"expected at least 2 days in train/, got {len(days)}")
    n = min(max(1, round(share * len(days))), len(days) - 1)
    return list(days[:-n]), list(days[-n:])


def check_speeds(
    stretches: Sequence[Stretch],
    segments: Sequence[str],
    where: str,
    unit: str,
    max_missing: float,
    trust_unit: bool = False,
) -> None:
    """Refuses speeds that would mislead a forecaster.

    Args:
        stretches: In m/s.
        segments: Names of the columns.
        where: Path, for the message.
        unit: Unit in which the speeds were read.
        max_missing: Share of a column that may be missing.
        trust_unit: Whether to accept speeds that are implausible in the unit.

    Raises:
        InvalidInputError: A column is mostly missing or constant, a speed is negative, or the unit is implausible.
    """
    speeds = np.concatenate([one.speeds for one in stretches])
    missing = np.isnan(speeds).mean(axis=0)
    worst = int(missing.argmax())
    if missing[worst] > max_missing:
        raise InvalidInputError(
            f"'{where}': column '{segments[worst]}' lacks {100 * missing[worst]:.0f} % of its values, expected at most "
            f"{100 * max_missing:.0f} % ({int((missing > max_missing).sum())} of {len(segments)} columns lack more); "
            "allow it: --max-missing; fewer gaps: longer steps by --resample"
        )
    constant = np.flatnonzero(np.nanmax(speeds, axis=0) - np.nanmin(speeds, axis=0) < STANDS_STILL_MPS)
    if len(constant):
        value = float(np.nanmin(speeds[:, constant[0]])) / UNITS[unit]
        raise InvalidInputError(
            f"'{where}': column '{segments[constant[0]]}' is constant ({value:.4g} {unit}), expected speeds that change"
        )
    check_values(stretches, segments, where, unit, trust_unit)


def check_values(
    stretches: Sequence[Stretch], segments: Sequence[str], where: str, unit: str, trust_unit: bool = False
) -> None:
    """Refuses speeds that are negative or implausible; arguments as of `check_speeds`.

    Raises:
        InvalidInputError: A speed is negative, or the unit is implausible.
    """
    speeds = np.concatenate([one.speeds for one in stretches])
    if not np.isfinite(speeds).any():
        raise InvalidInputError(f"'{where}': expected speeds, got only missing ones")
    if np.nanmin(speeds) < 0.0:
        row, column = np.argwhere(speeds < 0.0)[0]
        value = float(speeds[row, column]) / UNITS[unit]
        raise InvalidInputError(
            f"'{where}': column '{segments[column]}' has the speed {value:.4g} {unit} in row {row + 1}, expected 0 or "
            "more"
        )
    if not trust_unit:
        _check_unit(speeds, segments, where, unit)


def _check_unit(speeds: Float32Array, segments: Sequence[str], where: str, unit: str) -> None:
    """Refuses a table, or one column of it, whose free speed no road has."""
    low, high = FREE_MPS
    free = float(np.nanquantile(speeds, 0.95))
    fastest, known = np.zeros(speeds.shape[1]), np.isfinite(speeds).any(axis=0)
    fastest[known] = np.nanquantile(speeds[:, known], 0.95, axis=0)
    if low <= free <= high and fastest.max() <= high:
        return
    whose = "the free speed (95 % of the values are below it)"
    if low <= free <= high:
        free = float(fastest.max())
        whose += f" of column '{segments[int(fastest.argmax())]}'"
    raw = free / UNITS[unit]
    others = [name for name, factor in UNITS.items() if name != unit and low <= raw * factor <= high]
    hint = f"; are these {' or '.join(others)}?" if others else ""
    raise InvalidInputError(
        f"'{where}': read as {unit}, {whose} is {raw:.4g} {unit} ({3.6 * free:.0f} km/h), expected {3.6 * low:.0f} to "
        f"{3.6 * high:.0f} km/h{hint}; if {unit} is right: --trust-unit"
    )
