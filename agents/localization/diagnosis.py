"""Diagnosis: warnings where the fixes say that a localizer's settings are wrong.

A filter with the right settings is surprised by its fixes as often as chance allows: the normalised innovation squared
(NIS) follows a chi-square distribution. Medians are compared, since a few wild fixes do not move them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dohyo.agents.localization.filters.consistency import quantile
from dohyo.agents.localization.outliers import GATE
from dohyo.agents.localization.settings import Settings
from dohyo.agents.localization.track import EstimatedTrack
from dohyo.sumo_networks.arrays import FloatArray

LEAST_FIXES = 10
TOO_SURE, TOO_UNSURE = 1.5, 0.25
"""Median NIS in units of the expected one beyond which a warning comes, if chance does not explain it either."""
MANY_BEYOND = 0.2
"""Share of fixes beyond the 95 % bound that one wild fix in twenty does not explain."""
MANY_REJECTED = 0.15
LOUD = 2.0
"""Ratio of measured to assumed noise from which on a warning comes."""


@dataclass(frozen=True, slots=True)
class SettingsWarning:
    """Something that the data say against the settings.

    Attributes:
        code: Short name, for programs.
        text: What was found, what was expected, and a remedy.
    """

    code: str
    text: str


def diagnose(track: EstimatedTrack, settings: Settings, stated: bool = False) -> list[SettingsWarning]:
    """Warnings about a track; empty where the fixes fit the settings.

    Args:
        track: Result of a localizer.
        settings: Its settings.
        stated: Whether each fix states its own standard deviation, so that the settings' one is not used.
    """
    return [*_of_nis(track, None if stated else settings.gnss_sigma_m), *_of_rejected(track)]


def median_band(count: int) -> tuple[float, float]:
    """Interval of the median NIS of so many fixes for a filter that is right, 99 %."""
    # The median's rank is binomial: about normal with standard deviation 0.5 / sqrt(n) in probability.
    half = min(2.58 * 0.5 / math.sqrt(count), 0.49)
    return quantile(3, 0.5 - half), quantile(3, 0.5 + half)


def measured_noise(times: FloatArray, samples: FloatArray) -> tuple[float, float]:
    """White noise of accelerometer [m/s^2 per root Hz] and gyroscope [rad/s per root Hz] in a recording.

    By the differences of consecutive samples, which a car's motion hardly changes; the axis that shakes most, in the
    loudest quarter of the seconds, so that standing at lights does not hide what driving brings.

    Args:
        times: (N,), s.
        samples: (N, 6) of the IMU.
    """
    step = float(np.median(np.diff(times)))
    each = max(4, round(1.0 / step))
    whole = len(samples) // each * each
    change = np.diff(samples[:whole].reshape(-1, each, 6), axis=1)
    std = np.median(np.abs(change), axis=1) / 0.6745 / math.sqrt(2.0)
    loud = np.quantile(std, 0.75, axis=0) * math.sqrt(step)
    return float(loud[:3].max()), float(loud[3:].max())


def check_noise(times: FloatArray, samples: FloatArray, settings: Settings) -> list[SettingsWarning]:
    """Warnings where the recording shakes more than the settings assume."""
    measured = measured_noise(times, samples)
    assumed = settings.noise.accelerometer, settings.noise.gyroscope
    out = []
    for name, unit, found, told in zip(
        ("accelerometer", "gyroscope"), ("m/s^2", "rad/s"), measured, assumed, strict=True
    ):
        if found > LOUD * told:
            out.append(
                SettingsWarning(
                    f"{name}-noise",
                    f"the {name} shakes with {found:.2g} {unit} per root Hz, {found / told:.0f} times as much as "
                    f"assumed ({told:.2g}): set noise.{name}={found:.2g}",
                )
            )
    return out


def _of_nis(track: EstimatedTrack, sigma_m: float | None) -> list[SettingsWarning]:
    """Warnings of fixes that surprise too much or too little; sigma_m is None where each fix has its own."""
    nis = track.nis
    if len(nis) < LEAST_FIXES:
        return []
    low, high = median_band(len(nis))
    expected, found = quantile(3, 0.5), float(np.median(nis))
    beyond = float(np.mean(nis > quantile(3, 0.95)))
    factor = math.sqrt(found / expected)
    if found > max(high, TOO_SURE * expected) or beyond > MANY_BEYOND:
        larger = f" (about {factor:.2g} times as large)" if factor > 1.0 else ""
        return [
            SettingsWarning(
                "too-sure",
                f"the fixes surprise the filter: median NIS {found:.1f}, expected {low:.1f} to {high:.1f}; "
                f"{100.0 * beyond:.0f} % of the fixes lie where it expects 5 %. It is too sure of itself: raise "
                + ("the receiver's sigma" if sigma_m else f"the column sigma{larger}")
                + " or the noise of the IMU",
            )
        ]
    if found < min(low, TOO_UNSURE * expected):
        fitting = (
            f"the receiver's sigma (about {sigma_m * factor:.2g} m fits"
            if sigma_m
            else f"the column sigma (about {factor:.2g} of it fits"
        )
        return [
            SettingsWarning(
                "too-unsure",
                f"the fixes are better than assumed: median NIS {found:.2f}, expected {low:.1f} to {high:.1f}. Lower "
                f"{fitting}, less where its errors change slowly) or the noise of the IMU",
            )
        ]
    return []


def _of_rejected(track: EstimatedTrack) -> list[SettingsWarning]:
    count = len(track.fixes)
    surprising = int((track.nis > GATE).sum())
    for number, what, code in (
        (track.rejected, "were left out as outliers", "many-left-out"),
        (surprising, f"surprised the filter (NIS above {GATE})", "many-surprising"),
    ):
        if count >= LEAST_FIXES and number > MANY_REJECTED * count:
            return [
                SettingsWarning(
                    code,
                    f"{number} of {count} fixes {what}: the settings are wrong, or the receiver had no clear sky. "
                    "Compare sigma, noise and start with the log",
                )
            ]
    return []
