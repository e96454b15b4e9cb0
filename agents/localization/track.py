"""Track: result of a localizer on a whole recording."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dohyo.agents.localization.localizer import Fix, Localizer
from dohyo.agents.localization.outliers import JudgedFix
from dohyo.agents.localization.smoother import RecordedEsEkf
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError


@dataclass(frozen=True)
class EstimatedTrack:
    """Estimated poses after every IMU sample since the filter runs.

    Attributes:
        row: (K,) rows of the IMU's samples.
        time: (K,), s.
        position: (K, 2) east, north, m.
        heading: (K,), rad.
        covariance: (K, 2, 2), m^2, of east and north.
        fixes: Every fix that came while the filter ran.
        step_us: Wall-clock time per IMU sample, fixes included, microseconds.
    """

    row: FloatArray
    time: FloatArray
    position: FloatArray
    heading: FloatArray
    covariance: FloatArray
    fixes: Sequence[JudgedFix]
    step_us: float

    @property
    def nis(self) -> FloatArray:
        """(M,) normalised innovation squared of every fix."""
        return np.array([fix.innovation.nis for fix in self.fixes])

    @property
    def rejected(self) -> int:
        """Number of fixes left out as outliers."""
        return sum(not fix.used for fix in self.fixes)

    def within(self, first_s: float, last_s: float) -> EstimatedTrack:
        """The part between two times."""
        inside = (self.time >= first_s) & (self.time <= last_s)
        row, position, heading = self.row[inside], self.position[inside], self.heading[inside]
        return replace(
            self,
            row=row,
            time=self.time[inside],
            position=position,
            heading=heading,
            covariance=self.covariance[inside],
            fixes=tuple(fix for fix in self.fixes if first_s <= fix.time <= last_s),
        )


def follow(
    localizer: Localizer,
    times: FloatArray,
    samples: FloatArray,
    fixes: Sequence[Fix],
    wheel_speeds: Sequence[tuple[float, float]] = (),
) -> EstimatedTrack:
    """Runs a localizer on a recording, in order of time.

    Args:
        localizer: A fresh one.
        times: (N,), s, of the IMU's samples, increasing.
        samples: (N, 6) specific force [m/s^2] and angular rate [rad/s].
        fixes: In order of time.
        wheel_speeds: Times [s] and speeds [m/s], in order of time.

    Raises:
        InvalidInputError: The vehicle did not stand still at first, or never moved far enough to give its heading.
    """
    poses, covariances, first, next_fix, next_speed = [], [], len(times), 0, 0
    began = time.perf_counter()
    for row, now in enumerate(times.tolist()):
        localizer.imu(now, samples[row])
        while next_speed < len(wheel_speeds) and wheel_speeds[next_speed][0] <= now + 1e-6:
            localizer.wheel_speed(*wheel_speeds[next_speed])
            next_speed += 1
        while next_fix < len(fixes) and fixes[next_fix].time <= now + 1e-6:
            fix = fixes[next_fix]
            localizer.gnss(fix.time, fix.position, fix.sigma_m)
            next_fix += 1
        if localizer.filter is not None:
            first = min(first, row)
            poses.append(localizer.pose)
            covariances.append(localizer.filter.position_covariance)
    spent = time.perf_counter() - began
    if not poses:
        raise InvalidInputError(
            f"localizer: expected the vehicle to move {localizer.least_m:.1f} m from its start by IMU and GNSS, or "
            "from a later first fix, got less: its heading is unknown"
        )
    table = np.array(poses, dtype=np.float64)
    return EstimatedTrack(
        row=np.arange(first, len(times), dtype=np.float64),
        time=times[first:],
        position=table[:, :2],
        heading=table[:, 2],
        covariance=np.array(covariances)[:, :2, :2],
        fixes=tuple(localizer.fixes),
        step_us=1e6 * spent / len(times),
    )


def smooth(
    localizer: Localizer,
    track: EstimatedTrack,
    times: FloatArray,
    samples: FloatArray,
    fixes: Sequence[Fix],
    wheel_speeds: Sequence[tuple[float, float]] = (),
) -> EstimatedTrack:
    """Smoothed track of a recording that has been followed, at the times of the IMU's samples.

    A second run of the ES-EKF uses every fix that the first one did not leave out, and never scales its covariance: a
    jump of the covariance would be smoothed as a jump of the vehicle. After a rolling start the track begins at the
    first fix, earlier than the filter's.

    Args:
        localizer: As it is after `follow`.
        track: The filter's.
        times: (N,), s, of the IMU's samples.
        samples: (N, 6), as for `follow`.
        fixes: As for `follow`.
        wheel_speeds: As for `follow`.

    Raises:
        InvalidInputError: The filter is not the ES-EKF.
    """
    start = "rolling" if localizer.rolling else "standing"
    settings = localizer.settings.model_copy(update={"outliers": "none", "smooth": True, "start": start})
    again = Localizer(settings, localizer.heading, left_out=[fix.time for fix in track.fixes if not fix.used])
    follow(again, times, samples, fixes, wheel_speeds)
    if not isinstance(again.filter, RecordedEsEkf):
        raise InvalidInputError(f"smoother: expected the filter es-ekf, got {settings.filter}")
    states = again.filter.smoothed()
    rows = np.flatnonzero((times >= states.time[0] - 1e-9) & (times <= states.time[-1] + 1e-6))
    at = times[rows]
    covariance = [[np.interp(at, states.time, states.covariance[:, i, j]) for j in (0, 1)] for i in (0, 1)]
    return replace(
        track,
        row=rows.astype(np.float64),
        time=at,
        position=np.column_stack([np.interp(at, states.time, states.position[:, axis]) for axis in (0, 1)]),
        heading=np.interp(at, states.time, states.heading),
        covariance=np.moveaxis(np.array(covariance), -1, 0),
    )
