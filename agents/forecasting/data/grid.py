"""Grid: rows at the times at which a detector reports them become rows at equal steps; several detectors become one.

One rule of missing values holds for all tables: a step within a stretch without a value of a column is missing, whether
its cell is empty, its row is left out, or its row lies too far off the grid. An interruption of more than
`LONGEST_GAP_ROWS` steps ends a stretch, and so does midnight; interruptions are not missing values.

Of tables that grow, the last step may still be arriving: see `Grid.arrived`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dohyo.agents.forecasting.data.speed_table import DAY_S, Stretch
from dohyo.sumo_networks.arrays import Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.errors import InvalidInputError

LONGEST_GAP_ROWS = 60
"""Number of steps after which a new stretch begins."""
FAR_OFF = 0.25
"""Share of a step off the grid from which on a row is counted in the notes."""
FIRST_ROWS = 31
"""Rows of each file that decide where the grid lies."""
COMMON_STEPS_S = (10.0, 15.0, 20.0, 30.0, 60.0, 120.0, 180.0, 300.0, 360.0, 600.0, 900.0, 1200.0, 1800.0, 3600.0)
NEAR = 0.1
"""Steps of detectors, and the distance within which uneven times are taken as one of them."""


@dataclass(frozen=True)
class Rows:
    """Rows of one file as they were reported.

    Attributes:
        source: Path, for messages.
        time_s: (R,), increasing, some may be equal.
        names: Of the columns.
        speeds: (R, N), m/s, NaN where missing.
        offset_s: How far the clock of the last time is ahead of UTC; None: times without a zone.
        notes: What was decided in reading them, one sentence each.
        local: Whether the times are dates without a zone, so that their place in UTC is not known.
    """

    source: str
    time_s: FloatArray
    names: tuple[str, ...]
    speeds: Float32Array
    offset_s: float | None = None
    notes: tuple[str, ...] = ()
    local: bool = False


@dataclass(frozen=True)
class Grid:
    """Rows of all files at equal steps.

    Attributes:
        step_s: Seconds between two steps.
        start_s: Time of place 0.
        place: (R,) number of steps from there, increasing.
        names: Of the columns of all files.
        speeds: (R, N), m/s, NaN where missing.
        notes: What was done to the rows, one sentence each.
        complete: Place of the last step that every file has; or the one before the last that any file has, so that a
            silent file delays the others by one step. A step of means is complete once a row after it is there.
        offset_s: Of the first file, see `Rows`.
        named_by_file: See `SpeedData`.
    """

    step_s: float
    start_s: float
    place: IntArray
    names: tuple[str, ...]
    speeds: Float32Array
    notes: tuple[str, ...]
    complete: int
    offset_s: float | None
    named_by_file: bool = False

    @property
    def last_s(self) -> float:
        """Time of the last row."""
        return self.start_s + self.step_s * int(self.place[-1])

    @property
    def steps(self) -> int:
        """Number of steps from the first row to the last one."""
        return int(self.place[-1] - self.place[0]) + 1

    def arrived(self) -> Grid:
        """Rows of the complete steps alone.

        Raises:
            InvalidInputError: No step is complete yet.
        """
        rows = self.place <= self.complete
        if not rows.any():
            raise InvalidInputError("expected a step that is complete, got only the first rows of one")
        return replace(self, place=self.place[rows], speeds=self.speeds[rows])

    def chosen(self, columns: Sequence[int], note: str) -> Grid:
        """Columns by their numbers, and a note about them."""
        names = tuple(self.names[column] for column in columns)
        return replace(self, names=names, speeds=self.speeds[:, columns], notes=(*self.notes, note))

    def stretches(self, name: str) -> list[Stretch]:
        """Stretches of equal steps, skipped ones as missing values; see the module."""
        time_s = self.start_s + self.step_s * self.place
        day = np.floor_divide(time_s, DAY_S).astype(int)
        hole = np.diff(self.place) > LONGEST_GAP_ROWS
        starts = np.flatnonzero(np.concatenate([[True], hole | (np.diff(day) > 0)]))
        out = []
        for begin, end in zip(starts, [*starts[1:], len(self.place)], strict=True):
            first = self.place[begin]
            even = np.full((self.place[end - 1] - first + 1, self.speeds.shape[1]), np.nan, dtype=np.float32)
            even[self.place[begin:end] - first] = self.speeds[begin:end]
            out.append(Stretch(f"{name}:{begin + 1}", float(time_s[begin] % DAY_S), even, day=int(day[begin])))
        return out


def usual_step(time_s: FloatArray) -> float | None:
    """Step of a detector, s: its most frequent difference of times if most are equal, else the mean of the short ones.

    A mean near a step that detectors use is that step. One row has no step.
    """
    steps = np.diff(time_s)
    steps = steps[steps > 0.0]
    if not len(steps):
        return None
    values, counts = np.unique(np.round(steps, 3), return_counts=True)
    if counts.max() >= 0.5 * len(steps):
        return float(values[counts.argmax()])
    mean = float(np.mean(steps[steps <= 1.5 * np.median(steps)]))
    nearest = min(COMMON_STEPS_S, key=lambda step: abs(step - mean))
    return nearest if abs(nearest - mean) <= NEAR * nearest else mean


def on_grid(files: Sequence[Rows], step_s: float | None, tolerance: float, resample_s: float | None) -> Grid:
    """Puts the rows of one or several files on one grid.

    Args:
        files: In the order of their columns along the road.
        step_s: Step, s; None: the usual step of the first file.
        tolerance: Largest distance of a row from its step, in steps; farther ones are left out.
        resample_s: Length of new steps, s, whose values are means over all rows within; None: rows keep their steps.

    Raises:
        InvalidInputError: The steps of two files differ, new steps are shorter than the old ones, or some files alone
            have times without a zone.
    """
    _check_zones(files)
    usual = [usual_step(one.time_s) for one in files]
    step = resample_s or step_s or next((found for found in usual if found), 60.0)
    for one, found in zip(files, usual, strict=True):
        if found is None:
            continue
        if resample_s and resample_s < 0.99 * found:
            raise InvalidInputError(
                f"'{one.source}': expected --resample of at least {found / 60:g} minutes, the step of its rows, got "
                f"{resample_s / 60:g}"
            )
        if not resample_s and abs(found - step) > 1e-3 * step:
            raise InvalidInputError(
                f"'{one.source}': expected a row every {step:g} s, got times {found:g} s apart; means over equal "
                f"steps: --resample {max(found, step) / 60:g}"
            )
    start = min(float(one.time_s[0]) for one in files) // step * step if resample_s else _start(files, step)
    notes = list(dict.fromkeys(note for one in files for note in one.notes))
    parts = [_placed(one, start, step, 1.0 if resample_s else tolerance, bool(resample_s), notes) for one in files]
    place = np.unique(np.concatenate([part[0] for part in parts]))
    columns = []
    for own, speeds in parts:
        wide = np.full((len(place), speeds.shape[1]), np.nan, dtype=np.float32)
        wide[np.searchsorted(place, own)] = speeds
        columns.append(wide)
    if len(files) > 1:
        notes.append(f"{len(files)} files joined by time")
    names = _joined_names(files)
    last = [int(own[-1]) - bool(resample_s) for own, _ in parts]
    complete = max(min(last), max(last) - 1)
    return Grid(
        step_s=step,
        start_s=start,
        place=place,
        names=names,
        speeds=np.concatenate(columns, axis=1),
        notes=tuple(notes),
        complete=complete,
        offset_s=files[0].offset_s,
        named_by_file=names != tuple(name for one in files for name in one.names),
    )


def _check_zones(files: Sequence[Rows]) -> None:
    """Refuses files of which some have times with a zone and others without, since the latter may lie hours apart."""
    zoned = [one.source for one in files if one.offset_s is not None]
    local = [one.source for one in files if one.local]
    if zoned and local:
        raise InvalidInputError(
            f"'{local[0]}': expected times with an offset from UTC, as in '{zoned[0]}', got times without one; write "
            "the times of all files with an offset, such as 2026-03-02T00:00:00+01:00, or all without"
        )


def _start(files: Sequence[Rows], step: float) -> float:
    """Time of place 0: the middle one of the first rows, by their distances from equal steps.

    A late first row moves no other one. Later rows do not count, so that the steps of a growing table keep their times.
    """
    first = min(float(one.time_s[0]) for one in files)
    time_s = np.concatenate([one.time_s[:FIRST_ROWS] for one in files])
    phase = (time_s - first) / step
    mean = float(np.angle(np.exp(2j * np.pi * phase).mean())) / (2.0 * np.pi)
    off = phase - mean - np.round(phase - mean)
    middle = float(time_s[np.argsort(off, kind="stable")[(len(off) - 1) // 2]])
    return middle - step * round((middle - first) / step)


def _placed(
    one: Rows, start: float, step: float, tolerance: float, resampled: bool, notes: list[str]
) -> tuple[IntArray, Float32Array]:
    """Places of a file's rows, each once, and the means of the values of each."""
    exact = (one.time_s - start) / step
    place = np.floor(exact + 1e-9).astype(int) if resampled else np.round(exact).astype(int)
    off = np.abs(exact - place)
    kept = off <= tolerance + 1e-9
    if not kept.any():
        raise InvalidInputError(f"'{one.source}': expected rows within {tolerance:g} steps of the grid, got none")
    if not resampled and (off > FAR_OFF).any():
        notes.append(
            f"{int((off > FAR_OFF).sum())} of {len(off)} rows lie more than a quarter of a step off the grid, "
            f"{int((~kept).sum())} of them are left out (--tolerance {tolerance:g})"
        )
    place, speeds = place[kept], one.speeds[kept]
    unique, group = np.unique(place, return_inverse=True)
    if len(unique) == len(place):
        return unique, speeds
    known = np.isfinite(speeds)
    sums, counts = np.zeros((2, len(unique), speeds.shape[1]))
    np.add.at(sums, group, np.where(known, speeds, 0.0))
    np.add.at(counts, group, known)
    notes.append(f"{len(place)} rows became means of {len(unique)} steps")
    means = np.where(counts > 0, sums / np.maximum(counts, 1.0), np.nan)
    return unique, means.astype(np.float32)


def _joined_names(files: Sequence[Rows]) -> tuple[str, ...]:
    """Names of all columns; with the file's name where files share one."""
    if len(files) == 1:
        return files[0].names
    all_names = [name for one in files for name in one.names]
    shared = {name for name in all_names if all_names.count(name) > 1}
    out = []
    for one in files:
        stem = one.source.rpartition("/")[2].rpartition(".")[0]
        out += [(stem if len(one.names) == 1 else f"{stem}:{name}") if name in shared else name for name in one.names]
    return tuple(out)
