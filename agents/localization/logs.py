"""Logs: real recordings as CSV files, with checks of columns and units.

IMU: t, ax, ay, az, gx, gy, gz (s, m/s^2, rad/s; x forward, y left, z up). GNSS and truth: t, lat, lon, alt (degrees, m)
or t, x, y, z (m, east, north, up); the height may be missing. Fixes may have a column sigma, the standard deviation of
each, m. Wheel speeds: t, v (m/s).
"""

from __future__ import annotations

import csv
import logging
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from dohyo.agents.localization.localizer import SAME_TIME_S, SLOWEST_STEP_S, Fix
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import GRAVITY
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.projection import geodetic_to_enu
from dohyo.sumo_networks.portable_math import arctan2

IMU_COLUMNS = ("t", "ax", "ay", "az", "gx", "gy", "gz")
GEODETIC, PLANE = ("lat", "lon", "alt"), ("x", "y", "z")
MAX_IMU_GAP_S = 1.0
MAX_MISSING = 0.05
"""Share of the IMU's samples that may be unreadable or repeated."""
EARLY_SAMPLES = 10
"""Number of samples that may precede a silence at the start of a log."""
MAX_SPEED_MPS = 80.0
START_S = 20.0
"""Length of a start, of whose fixes the errors count as equal."""
SEPARATORS = {";": "';'", "\t": "a tab"}
"""Of columns in other logs than ours."""
STANDING_RATE = 0.5
"""Upper bound of a gyroscope's offset, rad/s."""

log = logging.getLogger(__name__)
Origin = tuple[float, float, float]


@dataclass(frozen=True)
class ImuLog:
    """Samples of an IMU.

    Attributes:
        time: (N,), s, increasing.
        samples: (N, 6) specific force [m/s^2] and angular rate [rad/s].
    """

    time: FloatArray
    samples: FloatArray


@dataclass(frozen=True)
class PositionLog:
    """Positions by time.

    Attributes:
        time: (M,), s, increasing.
        position: (M, 3), m: east, north, up of the origin.
        origin: Latitude, longitude [degrees] and height [m] if the file has them; None if it is in metres.
        sigma_m: (M,) standard deviation in east and north; None if the file has none.
    """

    time: FloatArray
    position: FloatArray
    origin: Origin | None
    sigma_m: FloatArray | None = None

    @property
    def start_sigma_m(self) -> float | None:
        """Median standard deviation of the first fixes, m, by which a start at rest judges them; None: unknown."""
        if self.sigma_m is None:
            return None
        return float(np.median(self.sigma_m[self.time <= self.time[0] + START_S]))

    def fixes(self) -> list[Fix]:
        """One per row."""
        sigmas = [None] * len(self.time) if self.sigma_m is None else self.sigma_m.tolist()
        return [Fix(float(t), at, sigma) for t, at, sigma in zip(self.time, self.position, sigmas, strict=True)]


def read_imu(path: Path) -> ImuLog:
    """Reads the samples of an IMU.

    Repeated time stamps and rows with missing numbers are left out, up to one in twenty.

    Raises:
        InvalidInputError: A column is missing or no number, time runs backwards or stops, or the units are wrong.
    """
    table, rows = _read(path, IMU_COLUMNS), 0
    rows, table = len(table), _usable(path, table)
    if rows - len(table) > MAX_MISSING * rows:
        raise InvalidInputError(f"'{path}': {rows - len(table)} of {rows} rows are repeated or have missing numbers")
    table = _without_early_samples(path, table)
    time, samples = table[:, 0], table[:, 1:]
    step = np.diff(time)
    if np.median(step) > SLOWEST_STEP_S + SAME_TIME_S:
        hint = ": is t in milliseconds?" if np.median(step) > 1.0 else ""
        raise InvalidInputError(
            f"'{path}': expected samples at 5 Hz or faster, got one in {np.median(step):.3g} s{hint}"
        )
    if step.max() > MAX_IMU_GAP_S:
        at = time[step.argmax()]
        raise InvalidInputError(
            f"'{path}': the IMU is silent for {step.max():.3g} s after t = {at:.3f} s; at most {MAX_IMU_GAP_S} s can "
            "be bridged"
        )
    _check_units(path, samples)
    return ImuLog(time, samples)


def read_wheel_speeds(path: Path) -> list[tuple[float, float]]:
    """Times [s] and speeds [m/s] of a car by its wheels.

    Raises:
        InvalidInputError: A column is missing or no number, time runs backwards, or a speed is impossible.
    """
    table = _usable(path, _read(path, ("t", "v")))
    fastest = float(np.abs(table[:, 1]).max())
    if fastest > MAX_SPEED_MPS:
        raise InvalidInputError(f"'{path}': a speed of {fastest:.3g} m/s: is v in km/h? Expected m/s")
    return [(t, v) for t, v in table.tolist()]


def read_positions(path: Path, origin: Origin | None = None) -> PositionLog:
    """Reads fixes or true positions.

    Rows with missing numbers, as receivers write without a fix, and repeated time stamps are left out.

    Args:
        path: The CSV file.
        origin: Of east, north and up; None: the first position of the file.

    Raises:
        InvalidInputError: A column is missing or no number, time runs backwards, or a coordinate is impossible.
    """
    header = _header(path)
    geodetic = {"lat", "lon"} <= header
    if not geodetic and not {"x", "y"} <= header:
        raise InvalidInputError(
            f"'{path}': expected the columns t, lat, lon, alt or t, x, y, z, got {', '.join(sorted(header))}"[:200]
        )
    names = [name for name in (GEODETIC if geodetic else PLANE) if name in header]
    has_sigma = "sigma" in header
    table = _usable(path, _read(path, ("t", *names, *(["sigma"] if has_sigma else []))))
    sigma = table[:, -1] if has_sigma else None
    table = table[:, :-1] if has_sigma else table
    if sigma is not None and not (sigma > 0.0).all():
        raise InvalidInputError(f"'{path}': expected sigma above 0 m in every row, got {sigma.min():g}")
    if len(names) == 2:
        table = np.column_stack([table, np.zeros(len(table))])
    if not geodetic:
        return PositionLog(table[:, 0], table[:, 1:], None, sigma)
    if np.abs(table[:, 1]).max() > 90.0:
        swapped = ": are lat and lon swapped?" if np.abs(table[:, 2]).max() <= 90.0 else ""
        raise InvalidInputError(f"'{path}': expected latitudes from -90 to 90, got {table[0, 1]:.6g}{swapped}")
    if np.abs(table[:, 2]).max() > 180.0:
        raise InvalidInputError(f"'{path}': expected longitudes from -180 to 180, got {np.abs(table[:, 2]).max():.6g}")
    origin = origin or (float(table[0, 1]), float(table[0, 2]), float(table[0, 3]))
    return PositionLog(table[:, 0], geodetic_to_enu(table[:, 1:], origin), origin, sigma)


def check_together(imu: ImuLog, gnss: PositionLog) -> None:
    """Checks that two recordings are of one journey.

    Raises:
        InvalidInputError: They do not overlap, or turn different ways.
    """
    overlap = min(imu.time[-1], gnss.time[-1]) - max(imu.time[0], gnss.time[0])
    if overlap <= 0.0:
        raise InvalidInputError(
            f"IMU and GNSS do not overlap in time: t is {imu.time[0]:.3f} to {imu.time[-1]:.3f} s in one, "
            f"{gnss.time[0]:.3f} to {gnss.time[-1]:.3f} s in the other"
        )
    turned, course = _turns(imu, gnss)
    if np.abs(course).sum() < 1.0:
        return  # the journey is too straight for a check
    slope = float(turned @ course / (course @ course))
    if slope > 10.0:
        raise InvalidInputError(
            f"the IMU turns {slope:.0f} times as fast as the GNSS track: are gx, gy, gz in degrees/s?"
        )
    if slope < -0.5:
        raise InvalidInputError(
            "the IMU turns left where the GNSS track turns right: are lat and lon (or x and y) swapped, or does the "
            "IMU's z axis point down?"
        )


def _turns(imu: ImuLog, gnss: PositionLog) -> tuple[FloatArray, FloatArray]:
    """Turns of the IMU and of the course of the fixes between legs of at least 10 m, rad."""
    offset = np.median(imu.samples[: max(10, len(imu.samples) // 50), 5])
    heading = np.concatenate([[0.0], np.cumsum((imu.samples[1:, 5] - offset) * np.diff(imu.time))])
    rows = [0]
    for row in range(1, len(gnss.time)):
        if np.hypot(*(gnss.position[row, :2] - gnss.position[rows[-1], :2])) >= 10.0:
            rows.append(row)
    if len(rows) < 4:
        return np.zeros(1), np.zeros(1)
    legs = np.diff(gnss.position[rows, :2], axis=0)
    course = np.unwrap(arctan2(legs[:, 1], legs[:, 0]))
    middle = 0.5 * (gnss.time[rows][1:] + gnss.time[rows][:-1])
    return np.diff(np.interp(middle, imu.time, heading)), np.diff(course)


def _header(path: Path) -> set[str]:
    try:
        with path.open(encoding="utf-8-sig") as file:
            names = next(csv.reader([file.readline()]), [])
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InvalidInputError(f"cannot read '{path}': {error}") from error
    if len(names) == 1 and (found := [told for separator, told in SEPARATORS.items() if separator in names[0]]):
        raise InvalidInputError(f"'{path}': expected columns separated by commas, got {found[0]} in line 1")
    return {name.strip() for name in names}


def _read(path: Path, names: tuple[str, ...]) -> FloatArray:
    """(N, len(names)) columns of a CSV file; NaN for empty cells."""
    header = _header(path)
    if missing := [name for name in names if name not in header]:
        raise InvalidInputError(f"'{path}': no column {', '.join(missing)}; expected {', '.join(names)}")
    try:
        frame = pl.read_csv(path, null_values=["", "nan", "NaN", "NAN", "null"], infer_schema_length=None)
        frame = frame.rename({name: name.strip() for name in frame.columns})
        table = frame.select(pl.col(names).cast(pl.Float64, strict=True)).to_numpy().astype(np.float64)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InvalidInputError(f"'{path}': {str(error).splitlines()[0]}") from error
    if len(table) < 2:
        raise InvalidInputError(f"'{path}': expected at least 2 rows, got {len(table)}")
    return table


def _usable(path: Path, table: FloatArray) -> FloatArray:
    """Complete rows, each time stamp once."""
    whole = table[np.isfinite(table).all(axis=1)]
    if len(whole) < 2:
        raise InvalidInputError(f"'{path}': expected at least 2 rows without missing numbers, got {len(whole)}")
    step = np.diff(whole[:, 0])
    if (step < 0.0).any():
        row = int(np.argmax(step < 0.0))
        raise InvalidInputError(
            f"'{path}': time runs backwards, from t = {whole[row, 0]:.3f} to {whole[row + 1, 0]:.3f} s; sort the rows"
        )
    once = whole[np.concatenate([[True], step > 0.0])]
    if len(once) < len(table):
        log.warning(
            "'%s': %d of %d rows left out (missing numbers, repeated times)", path, len(table) - len(once), len(table)
        )
    return np.asarray(once)


def _without_early_samples(path: Path, table: FloatArray) -> FloatArray:
    """Rows after a silence within the first samples, as a logger writes that starts twice."""
    gaps = np.flatnonzero(np.diff(table[: EARLY_SAMPLES + 1, 0]) > MAX_IMU_GAP_S)
    if not len(gaps):
        return table
    first = int(gaps[-1]) + 1
    log.warning("'%s': %d samples before a silence at the start left out", path, first)
    return table[first:]


def _check_units(path: Path, samples: FloatArray) -> None:
    """Checks the first samples, in which the vehicle should stand, and all of them."""
    first = np.median(samples[: max(10, min(100, len(samples) // 10))], axis=0)
    force, rate = float(np.linalg.norm(first[:3])), float(np.linalg.norm(first[3:]))
    if 0.8 < force < 1.2:
        raise InvalidInputError(f"'{path}': the acceleration at the start is {force:.2f}: is it in g? Expected m/s^2")
    if force < 5.0:
        raise InvalidInputError(
            f"'{path}': the acceleration at the start is {force:.2f} m/s^2: has gravity been taken out? Expected the "
            f"specific force, {GRAVITY} m/s^2 at rest"
        )
    if first[2] < 0.8 * force:
        axis = "xyz"[int(np.abs(first[:3]).argmax())]
        sign = "-" if first[int(np.abs(first[:3]).argmax())] < 0 else ""
        raise InvalidInputError(
            f"'{path}': gravity lies along {sign}{axis}; expected z to point up (az near {GRAVITY})"
        )
    if rate > STANDING_RATE or np.abs(samples[:, 5]).max() > 2.0 * math.pi:
        raise InvalidInputError(
            f"'{path}': the gyroscope reads {rate:.2f} at the start and up to {np.abs(samples[:, 5]).max():.2f}: is it "
            "in degrees/s? Expected rad/s"
        )
