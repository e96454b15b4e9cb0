"""Calibration: the constant offsets of an IMU, averaged while the vehicle stands level, at the start of each journey.

Source: Albilani's thesis, 4.2.1 and 4.3.2.2: stationary, neutral gear, known tilt of 0; average, and subtract.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import GRAVITY
from dohyo.sumo_networks.errors import InvalidInputError

LEVEL_AND_AT_REST = np.array([0.0, 0.0, GRAVITY, 0.0, 0.0, 0.0])
MIN_SAMPLES = 20
MAX_RATE_SPREAD, MAX_FORCE_SPREAD = math.radians(2.0), 1.0
"""Standard deviations of a sample, rad/s and m/s^2, above which a vehicle does not stand. Ours."""


@dataclass(frozen=True)
class Calibration:
    """The offsets of one IMU on one journey.

    Attributes:
        offset: (6,) of the accelerometer [m/s^2] and the gyroscope [rad/s].
        std: (6,) standard deviation of each, from the spread of the samples averaged.
    """

    offset: FloatArray
    std: FloatArray

    def apply(self, samples: FloatArray) -> FloatArray:
        """(..., 6) samples without the offsets."""
        return np.asarray(samples - self.offset)


NONE = Calibration(np.zeros(6), np.zeros(6))
"""No correction of the IMU."""


def calibrate(samples: FloatArray) -> Calibration:
    """The offsets of an IMU on a vehicle that stands level.

    A tilt counts as an offset of the accelerometer.

    Args:
        samples: (N, 6) specific force [m/s^2] and angular rate [rad/s], body frame (x forward, y left, z up).

    Raises:
        InvalidInputError: Too few samples, or the vehicle moved.
    """
    if len(samples) < MIN_SAMPLES:
        raise InvalidInputError(f"calibration: expected at least {MIN_SAMPLES} samples at rest, got {len(samples)}")
    spread = samples.std(axis=0, ddof=1)
    # A slow, steady motion changes the means of the two halves rather than the spread.
    half = len(samples) // 2
    drift = np.abs(samples[:half].mean(axis=0) - samples[-half:].mean(axis=0))
    if spread[:3].max() > MAX_FORCE_SPREAD or spread[3:].max() > MAX_RATE_SPREAD or drift[3:].max() > MAX_RATE_SPREAD:
        raise InvalidInputError(
            "calibration: expected the vehicle to stand still, got a spread of "
            f"{spread[:3].max():.2g} m/s^2 (at most {MAX_FORCE_SPREAD}) and {spread[3:].max():.2g} rad/s "
            f"(at most {MAX_RATE_SPREAD:.2g})"
        )
    return Calibration(samples.mean(axis=0) - LEVEL_AND_AT_REST, spread / math.sqrt(len(samples)))
