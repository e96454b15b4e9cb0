"""Track: result of a localizer on a whole recording."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dohyo.agents.localization.filters import Innovation
from dohyo.agents.localization.localizer import Fix, Localizer
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
        innovations: Of every fix.
        rejected: Number of fixes left out as outliers.
        step_us: Wall-clock time per IMU sample, fixes included, microseconds.
    """

    row: FloatArray
    time: FloatArray
    position: FloatArray
    heading: FloatArray
    covariance: FloatArray
    innovations: Sequence[Innovation]
    rejected: int
    step_us: float


def follow(localizer: Localizer, times: FloatArray, samples: FloatArray, fixes: Sequence[Fix]) -> EstimatedTrack:
    """Runs a localizer on a recording, in order of time.

    Args:
        localizer: A fresh one.
        times: (N,), s, of the IMU's samples, increasing.
        samples: (N, 6) specific force [m/s^2] and angular rate [rad/s].
        fixes: In order of time.

    Raises:
        InvalidInputError: The vehicle did not stand still at first, or never moved far enough to give its heading.
    """
    poses, covariances, first, next_fix = [], [], len(times), 0
    began = time.perf_counter()
    for row, now in enumerate(times.tolist()):
        localizer.imu(now, samples[row])
        while next_fix < len(fixes) and fixes[next_fix].time <= now + 1e-6:
            localizer.gnss(fixes[next_fix].time, fixes[next_fix].position)
            next_fix += 1
        if localizer.filter is not None:
            first = min(first, row)
            poses.append(localizer.pose)
            covariances.append(localizer.filter.position_covariance)
    spent = time.perf_counter() - began
    if not poses:
        needed = max(localizer.settings.align_m, 4 * localizer.settings.gnss_sigma_m)
        raise InvalidInputError(
            f"localizer: expected the vehicle to move {needed:.1f} m from its start by IMU and GNSS, got less: "
            "its heading is unknown"
        )
    table = np.array(poses, dtype=np.float64)
    return EstimatedTrack(
        row=np.arange(first, len(times), dtype=np.float64),
        time=times[first:],
        position=table[:, :2],
        heading=table[:, 2],
        covariance=np.array(covariances)[:, :2, :2],
        innovations=tuple(localizer.innovations),
        rejected=localizer.rejected,
        step_us=1e6 * spent / len(times),
    )
