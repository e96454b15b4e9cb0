"""Late first fix: a recording whose start at rest does not explain how fast the fixes move begins at its first fix.

An IMU cannot tell a constant speed from rest. A start at rest without a fix then puts the whole way before the first
fix into one place. A recording shows it: the fixes and the IMU's track since the rest have different speeds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dohyo.agents.localization.filters.es_ekf import integrate
from dohyo.agents.localization.localizer import Fix, Localizer
from dohyo.agents.localization.settings import Settings
from dohyo.agents.localization.track import EstimatedTrack, follow
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import GRAVITY

EARLY_S, LEAST_EARLY = 10.0, 3
"""Time from the first fix on in which both speeds are measured, and the number of fixes that it has at least."""
RATIO, DIFFERENCE_MPS, SIGNIFICANT = 1.5, 1.0, 4.0
"""Speeds differ by more than drift: ratio, difference, and the latter in standard deviations of the fixes. Ours."""


def follow_from_start(
    settings: Settings,
    times: FloatArray,
    samples: FloatArray,
    fixes: Sequence[Fix],
    wheel_speeds: Sequence[tuple[float, float]] = (),
) -> tuple[Localizer, EstimatedTrack]:
    """Runs a localizer on a recording, with a rolling start if "auto" took one at rest that the fixes contradict.

    Args:
        settings: Of the localizer.
        times: (N,), s, of the IMU's samples, increasing.
        samples: (N, 6) specific force [m/s^2] and angular rate [rad/s].
        fixes: In order of time.
        wheel_speeds: Times [s] and speeds [m/s], in order of time.

    Raises:
        InvalidInputError: See `follow`.
    """
    localizer = Localizer(settings)
    track = follow(localizer, times, samples, fixes, wheel_speeds)
    if settings.start == "auto" and _contradicted(localizer, track, times, samples, fixes):
        localizer = Localizer(settings.model_copy(update={"start": "rolling"}))
        track = follow(localizer, times, samples, fixes, wheel_speeds)
    return localizer, track


def _contradicted(
    localizer: Localizer, track: EstimatedTrack, times: FloatArray, samples: FloatArray, fixes: Sequence[Fix]
) -> bool:
    """Whether the first fixes, which came late, move at another speed than the IMU's track from rest."""
    rest = float(times[0]) + localizer.settings.standing_s
    used = {fix.time for fix in track.fixes if fix.used}
    believed = [fix for fix in fixes if fix.time in used]
    if localizer.rolling or fixes[0].time <= rest or len(believed) < LEAST_EARLY:
        return False
    early = [fix for fix in believed if fix.time <= believed[0].time + EARLY_S]
    early = early if len(early) >= LEAST_EARLY else believed[:LEAST_EARLY]
    at = np.array([fix.time for fix in early])
    moving = (times > rest) & (times <= at[-1])
    own = _track_from_rest(times[moving], localizer.calibration.apply(samples[moving]), rest)
    by_imu = _speed(at, np.column_stack([np.interp(at, times[moving], own[:, axis]) for axis in (0, 1)]))
    by_fixes = _speed(at, np.array([fix.position[:2] for fix in early]))
    std = localizer.settings.gnss_sigma_m / math.sqrt(float(np.sum((at - at.mean()) ** 2)))
    unlike = abs(by_fixes - by_imu) > max(DIFFERENCE_MPS, SIGNIFICANT * std)
    return unlike and max(by_fixes, by_imu) > RATIO * min(by_fixes, by_imu)


def _track_from_rest(times: FloatArray, samples: FloatArray, rest: float) -> FloatArray:
    """(N, 3) positions after each calibrated sample, of a vehicle that stands level at a time, m."""
    nominal, out = np.zeros(19), np.empty((len(times), 3))
    nominal[6], nominal[18] = 1.0, -GRAVITY
    for row, dt in enumerate(np.diff(times, prepend=rest).tolist()):
        integrate(nominal, samples[row, :3], samples[row, 3:], dt)
        out[row] = nominal[:3]
    return out


def _speed(times: FloatArray, positions: FloatArray) -> float:
    """Speed of the straight line through (N, 2) positions, m/s."""
    since = times - times.mean()
    return float(np.hypot(*(since @ positions / (since @ since))))
