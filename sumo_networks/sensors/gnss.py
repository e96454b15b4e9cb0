"""GNSS: a position at 10 Hz with white and slowly changing errors and dropouts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from gymnasium.spaces import Box

from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.conditions import Conditions
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.projection import read_projection
from dohyo.sumo_networks.sensors.base import Sensor, Track
from dohyo.sumo_networks.world import World

VERTICAL = 1.5
_CEP = 1.1774  # circular error probable of a round normal distribution, in standard deviations of one axis


@dataclass(frozen=True, slots=True)
class GnssNoise:
    """Errors of a receiver.

    Attributes:
        sigma_m: Standard deviation of the error in east and in north, m; the error in height is 1.5 times as large.
        correlated_share: Share of the variance that changes slowly (first-order Gauss-Markov); the rest is white.
        correlation_s: Time constant of the slow part, s.
        rate_hz: Fixes per second: 10, or a whole part of it.
        dropout: Share of missing fixes, drawn for each fix.
    """

    sigma_m: float
    correlated_share: float = 0.5
    correlation_s: float = 60.0
    rate_hz: float = 10.0
    dropout: float = 0.0

    def __post_init__(self) -> None:
        """Checks the rate.

        Raises:
            InvalidInputError: Fixes would not be a whole number of ticks apart.
        """
        ticks = 10.0 / self.rate_hz if self.rate_hz > 0.0 else 0.0
        if ticks < 1.0 or not math.isclose(ticks, round(ticks)):
            raise InvalidInputError(f"rate_hz: expected 10, 5, 2 or another whole part of 10, got {self.rate_hz:g}")


L80 = GnssNoise(sigma_m=2.5 / _CEP)
"""Quectel L80 class: 2.5 m circular error probable. The split into white and slow is ours."""

RTK = GnssNoise(sigma_m=0.02)
"""A receiver with corrections: 0.01 m circular error in u-blox's data sheet of the ZED-F9P; twice that is ours."""


class GnssErrors:
    """Adds the errors of one receiver to true positions; the slow part persists from fix to fix."""

    def __init__(self, noise: GnssNoise, rng: np.random.Generator) -> None:
        self._noise, self._rng = noise, rng
        self._scale = noise.sigma_m * np.array([1.0, 1.0, VERTICAL])
        self._slow: FloatArray = rng.standard_normal(3)

    def corrupt(self, position: FloatArray, dt: float) -> FloatArray:
        """(3,) reported position [m] for a true position [m], `dt` [s] after the last one."""
        noise, drawn = self._noise, self._rng.standard_normal((2, 3))
        kept = math.exp(-dt / noise.correlation_s)
        self._slow = kept * self._slow + math.sqrt(1.0 - kept * kept) * drawn[0]
        share = noise.correlated_share
        error = math.sqrt(share) * self._slow + math.sqrt(1.0 - share) * drawn[1]
        return np.asarray(position + self._scale * error)


class Gnss(Sensor):
    """(9,) fix (0 or 1), x, y, z [m, network frame], latitude and longitude as in NMEA, and georeference (0 or 1).

    Columns: fix; x (east), y (north), z (up); latitude in whole degrees and minutes, longitude in whole degrees and
    minutes (a float32 resolves degrees to 0.4 m only, minutes to 1 cm); 1 if the network has a projection, 0 if
    latitude and longitude count from a local origin at 0, 0. Without a fix all other columns are 0. The antenna is at
    the box's centre. Errors are those of `L80`; conditions have no effect.
    """

    name = "gnss"
    track = Track.SENSORS
    space = Box(-np.inf, np.inf, (9,), np.float32)

    def __init__(self, rng: np.random.Generator, noise: GnssNoise = L80) -> None:
        self._noise, self._rng = noise, rng
        self._errors = GnssErrors(noise, rng)

    @classmethod
    def make(cls, conditions: Conditions, rng: np.random.Generator) -> Self:
        """Makes the sensor; see `Sensor`."""
        return cls(rng)

    def read(self, world: World, ego: int) -> Float32Array:
        """Reads the array; see the class."""
        every = round(10.0 / self._noise.rate_hz)
        missing = self._rng.random() < self._noise.dropout
        # Drawn at every tick, so that a lower rate does not change the errors of later ticks.
        x, y, z = self._errors.corrupt(np.append(world.egos.position[ego], 0.0), 0.1)
        if missing or world.tick % every:
            return np.zeros(9, dtype=np.float32)
        projection = read_projection(world.network.path)
        degrees = [_degrees_and_minutes(angle) for angle in projection.to_wgs84(float(x), float(y))]
        return np.array([1.0, x, y, z, *degrees[0], *degrees[1], projection.georeferenced], dtype=np.float32)


class GnssRtk(Gnss):
    """(9,) as `Gnss`, for a receiver with corrections (`RTK`)."""

    name = "gnss_rtk"

    def __init__(self, rng: np.random.Generator, noise: GnssNoise = RTK) -> None:
        super().__init__(rng, noise)


def _degrees_and_minutes(angle: float) -> tuple[float, float]:
    whole = math.trunc(angle)
    return float(whole), 60.0 * (angle - whole)
