"""Recordings whose first fix comes late: at a constant speed, which an IMU takes as rest, and after a rest."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.localization.late_fix import follow_from_start
from dohyo.agents.localization.localizer import Fix
from dohyo.agents.localization.settings import Settings
from dohyo.agents.localization.track import EstimatedTrack, smooth
from dohyo.sumo_networks.arrays import FloatArray

DT, LENGTH_S, FIRST_S = 0.01, 65.0, 30.0
SIGMA_M = 2.1
NOISE = np.array([0.1, 0.1, 0.1, 2e-3, 2e-3, 2e-3])
OFFSETS = np.array([0.2, 0.1, 0.0, 0.01, -0.01, 0.01])


def drive(speed_mps: float, set_off_s: float | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, positions and samples of a car that first keeps a speed, sets off at 2 m/s^2 for 5 s, and then bends."""
    time = DT * np.arange(1, round(LENGTH_S / DT) + 1)
    forward = np.zeros(len(time))
    if set_off_s is not None:
        forward[(time > set_off_s) & (time < set_off_s + 5.0)] = 2.0
    speed = speed_mps + np.cumsum(forward) * DT
    rate = np.where((time > FIRST_S + 10.0) & (speed > 0.0), 0.05 * np.sin((time - FIRST_S - 10.0) / 3.0), 0.0)
    heading = 0.5 + np.cumsum(rate) * DT
    position = np.cumsum(speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0) * DT
    still = np.zeros(len(time))
    samples = np.column_stack([forward, speed * rate, still + 9.81, still, still, rate])
    return time, position, samples + np.random.default_rng(0).standard_normal(samples.shape) * NOISE + OFFSETS


def localized(speed_mps: float, set_off_s: float | None) -> tuple[EstimatedTrack, FloatArray]:
    """The smoothed track, and its distances from the true one."""
    time, position, samples = drive(speed_mps, set_off_s)
    rows = np.searchsorted(time, np.arange(FIRST_S, LENGTH_S, 1.0) - 1e-6)
    noise = np.random.default_rng(1).normal(0.0, SIGMA_M, (len(rows), 2))
    fixes = [
        Fix(float(time[row]), np.array([*(position[row] + off), 0.0])) for row, off in zip(rows, noise, strict=True)
    ]
    localizer, track = follow_from_start(Settings(gnss_sigma_m=SIGMA_M), time, samples, fixes)
    smoothed = smooth(localizer, track, time, samples, fixes)
    return smoothed, np.hypot(*(smoothed.position - position[smoothed.row.astype(int)]).T)


@pytest.mark.parametrize("speed_mps", [3.0, 5.0])
def test_a_constant_speed_before_a_late_first_fix_is_no_rest(speed_mps: float) -> None:
    track, off = localized(speed_mps, None)
    assert track.time[0] == pytest.approx(FIRST_S, abs=0.02)
    assert off.max() < 4.0


def test_a_car_that_stood_for_long_after_its_first_fix_has_not_drifted_away() -> None:
    _, off = localized(0.0, 50.0)
    assert off.max() < 4.0


def test_a_car_that_set_off_before_its_first_fix_has_a_track_from_there() -> None:
    track, off = localized(0.0, 20.0)
    assert track.time[0] == pytest.approx(3.0, abs=0.05)
    assert off.max() < 6.0
