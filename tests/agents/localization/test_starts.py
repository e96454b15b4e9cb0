"""Standing starts whose first fix comes after the car set off, on a hand-made drive."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from dohyo.agents.localization.localizer import Fix, Localizer
from dohyo.agents.localization.settings import Settings
from dohyo.agents.localization.track import EstimatedTrack, follow, smooth
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError

DT, LENGTH_S, HEADING = 0.01, 45.0, 0.5
SIGMA_M = 0.5


@cache
def drive() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, positions and samples: 3.5 s at rest, 5 s at 2 m/s^2, then 10 m/s through a wide bend."""
    time = DT * np.arange(1, round(LENGTH_S / DT) + 1)
    forward = np.where((time > 3.5) & (time < 8.5), 2.0, 0.0)
    rate = np.where(time > 15.0, 0.05 * np.sin((time - 15.0) / 3.0), 0.0)
    speed, heading = np.cumsum(forward) * DT, HEADING + np.cumsum(rate) * DT
    position = np.cumsum(speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0) * DT
    still = np.zeros(len(time))
    samples = np.column_stack([forward, speed * rate, still + 9.81, still, still, rate])
    noise = np.random.default_rng(0).standard_normal(samples.shape) * [0.05, 0.05, 0.05, 1e-3, 1e-3, 1e-3]
    return time, position, samples + noise + np.array([0.2, 0.1, 0.0, 0.01, -0.01, 0.01])


def fixes(first_s: float, every_s: float) -> list[Fix]:
    time, position, _ = drive()
    rows = np.searchsorted(time, np.arange(first_s, LENGTH_S, every_s) - 1e-6)
    noise = np.random.default_rng(1).normal(0.0, SIGMA_M, (len(rows), 2))
    return [
        Fix(float(time[row]), np.array([*(position[row] + off), 0.0])) for row, off in zip(rows, noise, strict=True)
    ]


def off(track: EstimatedTrack) -> FloatArray:
    return np.hypot(*(track.position - drive()[1][track.row.astype(int)]).T)


@pytest.mark.parametrize("start", ["auto", "standing"])
@pytest.mark.parametrize(("first_s", "every_s"), [(12.0, 1.0), (12.0, 10.0), (20.0, 20.0)])
def test_a_late_first_fix_is_not_the_place_where_the_car_set_off(first_s: float, every_s: float, start: str) -> None:
    time, _, samples = drive()
    localizer = Localizer(Settings(gnss_sigma_m=SIGMA_M, start=start))
    seen = fixes(first_s, every_s)
    track = follow(localizer, time, samples, seen)
    smoothed = smooth(localizer, track, time, samples, seen)
    assert not localizer.rolling
    assert track.time[0] < first_s + max(every_s, 2.0) + 0.1
    assert off(track).max() < 5.0
    assert smoothed.time[0] == pytest.approx(3.0, abs=0.05), "from setting off"
    assert off(smoothed).max() < 8.0
    assert math.remainder(smoothed.heading[0] - HEADING, 2.0 * math.pi) == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("first_s", [3.012, 12.0])
def test_with_a_known_heading_it_runs_from_the_first_fix(first_s: float) -> None:
    time, _, samples = drive()
    localizer = Localizer(Settings(gnss_sigma_m=SIGMA_M), heading=(HEADING + 0.02, 0.05))
    track = follow(localizer, time, samples, fixes(first_s, 10.0))
    assert track.time[0] == pytest.approx(first_s, abs=0.02)
    assert off(track).max() < 5.0


def test_a_late_first_fix_asks_for_a_longer_way() -> None:
    """A heading from a few metres would shift the start far away."""
    time, _, samples = drive()
    before = time < 14.5
    with pytest.raises(InvalidInputError, match=r"expected the vehicle to move 28\.3 m .* from a later first fix"):
        follow(Localizer(Settings(gnss_sigma_m=2.0)), time[before], samples[before], fixes(12.0, 1.0)[:3])


def test_a_wild_first_fix_that_comes_late_is_no_start() -> None:
    time, _, samples = drive()
    wild, *good = fixes(12.0, 1.0)
    localizer = Localizer(Settings(gnss_sigma_m=SIGMA_M))
    follow(localizer, time, samples, [Fix(wild.time, wild.position + np.array([60.0, 80.0, 0.0])), *good])
    assert localizer.rolling
