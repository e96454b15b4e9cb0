"""Measurements as in the field: late segment speeds from a few probes, with gaps; pings; and space-time maps."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray, StringArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.freeway.road import FreewayRoad
from dohyo.sumo_networks.freeway.world import NO_LANE, FreewayWorld

MINUTE_S: Final = 60.0
MINUTES_PER_DAY: Final = 1440
PING_S: Final = 1.0
LAG_MINUTES: Final = 3
"""Longest time between a minute's end and its report, minutes."""
LEAST_SECONDS: Final = 5.0
"""Least total time of probes in a segment, s; with less, the minute has no speed."""
NOISE_MPS: Final = 0.3
"""Standard deviation of a reported speed around the probes' mean, m/s."""
OUTAGES_PER_DAY: Final = 0.6
"""Mean number of outages of one segment per day; they last 12 minutes on average."""
OUTAGE_MINUTES: Final = 12.0
FEED_OUTAGES_PER_DAY: Final = 0.15
"""Mean number of outages of all segments at once per day."""
SLOWEST_WAVE_MPS: Final = 2.0
"""Waves that travel more slowly are not looked for."""


def reported_speeds(speed_mps: FloatArray, seconds: FloatArray, rng: np.random.Generator) -> FloatArray:
    """(T, S) reported speeds from the probes' mean speeds, with noise, and with gaps as NaN.

    A minute has no speed if a segment has too few probes, and during outages of one segment or of the whole feed.

    Args:
        speed_mps: (T, S) mean speed of the probes by minute and segment, NaN without a probe.
        seconds: (T, S) time of the probes in the segment, summed over vehicles, s.
        rng: Generator of noise and outages.
    """
    minutes, segments = speed_mps.shape
    measured = _measured(speed_mps, seconds, rng)
    days = minutes / MINUTES_PER_DAY
    gaps = np.zeros(measured.shape, dtype=np.bool_)
    for segment in range(segments):
        gaps[:, segment] |= _outages(minutes, OUTAGES_PER_DAY * days, rng)
    gaps |= _outages(minutes, FEED_OUTAGES_PER_DAY * days, rng)[:, None]
    return np.where(gaps, np.nan, measured)


def _measured(speed_mps: FloatArray, seconds: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Speeds with noise, NaN with too few probes; arrays of any shape."""
    noisy = np.maximum(speed_mps + rng.normal(0.0, NOISE_MPS, speed_mps.shape), 0.0)
    return np.where(seconds < LEAST_SECONDS, np.nan, noisy)


def _outages(minutes: int, expected: float, rng: np.random.Generator) -> BoolArray:
    out = np.zeros(minutes, dtype=np.bool_)
    for _ in range(rng.poisson(expected)):
        start = int(rng.integers(minutes))
        out[start : start + _outage_minutes(rng)] = True
    return out


def _outage_minutes(rng: np.random.Generator) -> int:
    return max(1, round(rng.exponential(OUTAGE_MINUTES)))


class _LiveOutages:
    """Outages as they begin and last, minute by minute, of each segment and of all at once."""

    def __init__(self, segments: int, rng: np.random.Generator) -> None:
        self._left = np.zeros(segments, dtype=np.int64)  # minutes
        self._rng = rng

    def next_minute(self) -> BoolArray:
        """(S,) which segments are silent."""
        self._left = np.maximum(self._left - 1, 0)
        for segment in np.flatnonzero(self._rng.random(len(self._left)) < OUTAGES_PER_DAY / MINUTES_PER_DAY):
            self._left[segment] = max(self._left[segment], _outage_minutes(self._rng))
        if self._rng.random() < FEED_OUTAGES_PER_DAY / MINUTES_PER_DAY:
            self._left = np.maximum(self._left, _outage_minutes(self._rng))
        return self._left > 0


class SegmentFeed:
    """Segment speeds during a simulation: one row per minute, each with a delay of some minutes.

    Attributes:
        road: Freeway with the segments.
        lag_minutes: Time between a minute's end and its report, minutes.
    """

    def __init__(self, road: FreewayRoad, seed: int, lag_minutes: int = LAG_MINUTES) -> None:
        self.road = road
        self.lag_minutes = lag_minutes
        self._rng = np.random.default_rng(seed)
        self._outages = _LiveOutages(road.segments, self._rng)
        self._metres, self._seconds = np.zeros((2, road.segments))
        self._minute: int | None = None
        self._before_s = math.nan
        self._rows: list[tuple[int, FloatArray]] = []

    def observe(self, world: FreewayWorld) -> None:
        """Adds one world; call it every tick, or at least every few seconds."""
        minute = int(world.time_s // MINUTE_S)
        if self._minute is not None and minute != self._minute:
            self._close_minute(self._minute)
        passed = world.time_s - self._before_s if self._minute is not None else 1.0
        self._minute, self._before_s = minute, world.time_s
        seen = world.probe & (world.segment >= 0)
        np.add.at(self._metres, world.segment[seen], world.speed_mps[seen] * passed)
        np.add.at(self._seconds, world.segment[seen], passed)

    def reported(self, time_s: float) -> tuple[IntArray, FloatArray]:
        """Speeds that have arrived until a time of day.

        Returns:
            (M,) minutes since midnight, ascending; and (M, S) their speeds, m/s, NaN for gaps.
        """
        known = [(minute, row) for minute, row in self._rows if (minute + 1 + self.lag_minutes) * MINUTE_S <= time_s]
        speeds = np.array([row for _, row in known]).reshape(len(known), self.road.segments)
        return np.array([minute for minute, _ in known], dtype=np.int64), speeds

    def _close_minute(self, minute: int) -> None:
        some = self._seconds > 0
        mean = np.divide(self._metres, self._seconds, out=np.full(self.road.segments, np.nan), where=some)
        row = _measured(mean, self._seconds, self._rng)
        row[self._outages.next_minute()] = np.nan
        self._rows.append((minute, row))
        self._metres[:] = self._seconds[:] = 0.0


@dataclass(frozen=True, eq=False)
class Pings:
    """States that connected vehicles sent: K pings in the order of arrival.

    Attributes:
        time_s: (K,) time of day, s.
        name: (K,) SUMO id of the vehicle.
        position_m: (K,) position along the mainline, m.
        lane: (K,) lane, counted from the left.
        speed_mps: (K,) speed, m/s.
    """

    time_s: FloatArray
    name: StringArray
    position_m: FloatArray
    lane: IntArray
    speed_mps: FloatArray


class PingLog:
    """Pings of the last seconds: every connected vehicle on the mainline sends its state once per second."""

    def __init__(self, keep_s: float = MINUTE_S) -> None:
        self._keep_s = keep_s
        self._next_s = -math.inf
        self._kept: deque[Pings] = deque()

    def observe(self, world: FreewayWorld) -> None:
        """Adds one world; call it every tick."""
        if world.time_s < self._next_s:
            return
        self._next_s = world.time_s + PING_S
        rows = np.flatnonzero(world.connected & (world.lane != NO_LANE))
        names = np.array([world.names[row] for row in rows], dtype=np.str_)
        time_s = np.full(len(rows), world.time_s)
        self._kept.append(Pings(time_s, names, world.position_m[rows], world.lane[rows], world.speed_mps[rows]))
        while len(self._kept) > self._keep_s / PING_S:
            self._kept.popleft()

    def pings(self) -> Pings:
        """All pings kept, oldest first."""
        if not self._kept:
            none = np.empty(0)
            return Pings(none, np.empty(0, np.str_), none, np.empty(0, np.int64), none)
        columns = ("time_s", "name", "position_m", "lane", "speed_mps")
        return Pings(*(np.concatenate([getattr(one, column) for one in self._kept]) for column in columns))


class SpaceTimeMap:
    """Mean speeds on a grid of time and space, over all vehicles of the mainline.

    Attributes:
        cell_s: Duration of a cell, s.
        cell_m: Length of a cell along the mainline, m; cells begin at the first segment's start.
    """

    def __init__(self, road: FreewayRoad, start_s: float, duration_s: float, cell_s: float, cell_m: float) -> None:
        shape = math.ceil(duration_s / cell_s), math.ceil(road.bounds_m[-1] / cell_m)
        self.cell_s, self.cell_m = cell_s, cell_m
        self._start_s = start_s
        self._speed, self._count = np.zeros((2, *shape))

    def observe(self, world: FreewayWorld) -> None:
        """Adds one world; worlds outside the grid's time are ignored."""
        row = math.floor((world.time_s - self._start_s) / self.cell_s)
        if not 0 <= row < len(self._count):
            return
        on = (world.segment >= 0) & (world.position_m < self.cell_m * self._count.shape[1])
        column = (world.position_m[on] / self.cell_m).astype(np.int64)
        np.add.at(self._speed[row], column, world.speed_mps[on])
        np.add.at(self._count[row], column, 1.0)

    def speed_mps(self) -> FloatArray:
        """(time, space) mean speed, m/s; NaN without a vehicle."""
        some = self._count > 0
        return np.asarray(np.divide(self._speed, self._count, out=np.full_like(self._speed, np.nan), where=some))


def wave_speed(speed_mps: FloatArray, cell_s: float, cell_m: float, apart_m: float = 1000.0) -> float:
    """Speed of stop-and-go waves along the mainline, m/s; negative upstream.

    The speed follows from the delay with the highest correlation between two places, over all pairs of places
    `apart_m` apart; slow variations, which do not travel, are subtracted first.

    Args:
        speed_mps: (time, space) of a congested part of a map; NaNs count as the place's mean, and a place of NaNs alone
            is left out.
        cell_s: Duration of a cell, s.
        cell_m: Length of a cell, m.
        apart_m: Distance between the two places, m.

    Returns:
        The speed, m/s; NaN if all correlations are below 0.2.

    Raises:
        InvalidInputError: The map is too short, its cells are too coarse, or no two places `apart_m` apart have speeds.
    """
    apart, lags = round(apart_m / cell_m), np.arange(1, round(apart_m / SLOWEST_WAVE_MPS / cell_s))
    pairs = _measured_pairs(speed_mps, apart, len(lags))
    mean = np.nanmean(np.where(np.isnan(speed_mps).all(axis=0), 0.0, speed_mps), axis=0)
    filled = np.where(np.isnan(speed_mps), mean, speed_mps)
    width = max(3, round(600 / cell_s))
    kernel = np.ones(width) / width
    slow = np.array([np.convolve(np.pad(x, width // 2, "edge"), kernel, "valid")[: len(x)] for x in filled.T]).T
    waves = filled - slow
    up, down = waves[:, pairs], waves[:, pairs + apart]
    alike = np.array([_correlation(down[:-lag], up[lag:]) for lag in lags])
    best = int(np.argmax(alike))
    return -apart * cell_m / (float(lags[best]) * cell_s) if alike[best] >= 0.2 else math.nan


def _measured_pairs(speed_mps: FloatArray, apart: int, lags: int) -> IntArray:
    """(P,) the first of every two places some cells apart that were measured; see `wave_speed`."""
    times, places = speed_mps.shape
    if apart < 1 or lags < 1:
        raise InvalidInputError(
            "expected finer cells: two places must be a cell apart, and the delay two cells or more"
        )
    if times <= lags or places <= apart:
        raise InvalidInputError(
            f"expected a map of more than {lags} times and {apart} places, as the cells are, got {times} and {places}"
        )
    there = np.asarray(np.isfinite(speed_mps).any(axis=0))
    pairs = np.flatnonzero(there[:-apart] & there[apart:])
    if not len(pairs):
        raise InvalidInputError(f"expected two measured places {apart} cells apart, got none")
    return pairs


def _correlation(a: FloatArray, b: FloatArray) -> float:
    return float((a * b).sum() / math.sqrt((a * a).sum() * (b * b).sum() + 1e-12))
