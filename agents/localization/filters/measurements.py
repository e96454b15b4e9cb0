"""Measurements: what a filter corrects by. A fix of the antenna, and the velocity of a point that a car's wheels hold.

Jacobians are with respect to the ES-EKF's error state; the attitude's error is a rotation vector in the body frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, Self

import numpy as np

from dohyo.agents.localization.filters.attitude import skew
from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.sensors.gnss import VERTICAL

AT_IMU = (0.0, 0.0, 0.0)
Lever = tuple[float, float, float]


class Motion(NamedTuple):
    """Motion of the IMU by a filter's state.

    Attributes:
        position: (3,), m, navigation frame.
        velocity: (3,), m/s, navigation frame.
        rotation: (3, 3), body to navigation frame.
        rate: (3,), rad/s, body frame, without the gyroscope's bias.
    """

    position: FloatArray
    velocity: FloatArray
    rotation: FloatArray
    rate: FloatArray


class Measurement(Protocol):
    """Numbers that a state predicts.

    Attributes:
        value: (m,) measured.
        covariance: (m, m) of its noise.
    """

    @property
    def value(self) -> FloatArray: ...  # noqa: D102 - in the class's docstring

    @property
    def covariance(self) -> FloatArray: ...  # noqa: D102

    def expected(self, motion: Motion) -> FloatArray:
        """(m,) the value without noise."""
        ...

    def jacobian(self, motion: Motion) -> FloatArray:
        """(m, 18) derivative of `expected` by the error state."""
        ...

    def with_covariance(self, covariance: FloatArray) -> Self:
        """The same measurement with other noise."""
        ...


@dataclass(frozen=True, slots=True)
class AntennaPosition:
    """Fix of a GNSS receiver.

    Attributes:
        value: (3,), m, navigation frame.
        covariance: (3, 3), m^2.
        lever: Antenna seen from the IMU, m: forward, left, up.
    """

    value: FloatArray
    covariance: FloatArray
    lever: Lever = AT_IMU

    @classmethod
    def of(cls, position: FloatArray, sigma_m: float, lever: Lever = AT_IMU) -> AntennaPosition:
        """A fix (3,) [m] with a standard deviation in east and north [m]."""
        return cls(position, gnss_covariance(sigma_m), lever)

    def expected(self, motion: Motion) -> FloatArray:
        """See `Measurement`."""
        return np.asarray(motion.position + motion.rotation @ np.array(self.lever))

    def jacobian(self, motion: Motion) -> FloatArray:
        """See `Measurement`."""
        H = np.zeros((3, 18))
        H[:, 0:3], H[:, 6:9] = np.eye(3), -motion.rotation @ skew(np.array(self.lever))
        return H

    def with_covariance(self, covariance: FloatArray) -> Self:
        """See `Measurement`."""
        return replace(self, covariance=covariance)


@dataclass(frozen=True, slots=True)
class PointVelocity:
    """Components of the velocity of a point of the body, in the body frame.

    A wheel's speed is the forward one; a car that does not slide has 0 to the left and upwards at its rear axle.

    Attributes:
        value: (m,), m/s.
        covariance: (m, m), m^2/s^2.
        axes: (m,) components: 0 forward, 1 left, 2 up.
        lever: The point seen from the IMU, m.
    """

    value: FloatArray
    covariance: FloatArray
    axes: IntArray
    lever: Lever = AT_IMU

    @classmethod
    def of(cls, values: Sequence[float], sigmas: Sequence[float], axes: Sequence[int], lever: Lever) -> PointVelocity:
        """Independent components with standard deviations, m/s."""
        return cls(np.array(values), np.diag(np.array(sigmas) ** 2), np.array(axes), lever)

    def expected(self, motion: Motion) -> FloatArray:
        """See `Measurement`."""
        body = motion.rotation.T @ motion.velocity + np.cross(motion.rate, np.array(self.lever))
        return np.asarray(body[self.axes])

    def jacobian(self, motion: Motion) -> FloatArray:
        """See `Measurement`."""
        H = np.zeros((3, 18))
        H[:, 3:6] = motion.rotation.T
        H[:, 6:9] = skew(motion.rotation.T @ motion.velocity)
        H[:, 12:15] = skew(np.array(self.lever))
        return np.asarray(H[self.axes])

    def with_covariance(self, covariance: FloatArray) -> Self:
        """See `Measurement`."""
        return replace(self, covariance=covariance)


@dataclass(frozen=True, slots=True)
class LevelRoad:
    """A car on a road that is nearly level: the sines of its tilt about the left and the forward axis are small.

    Attributes:
        value: (2,) zeros.
        covariance: (2, 2).
    """

    value: FloatArray
    covariance: FloatArray

    @classmethod
    def of(cls, sigma_rad: float) -> LevelRoad:
        """Roads with a standard deviation of their slope."""
        return cls(np.zeros(2), np.eye(2) * sigma_rad**2)

    def expected(self, motion: Motion) -> FloatArray:
        """See `Measurement`."""
        return motion.rotation[2, :2].copy()

    def jacobian(self, motion: Motion) -> FloatArray:
        """See `Measurement`."""
        H = np.zeros((2, 18))
        for axis in (0, 1):
            H[axis, 6:9] = -motion.rotation[2] @ skew(np.eye(3)[axis])
        return H

    def with_covariance(self, covariance: FloatArray) -> Self:
        """See `Measurement`."""
        return replace(self, covariance=covariance)


def is_plain(measurement: Measurement) -> bool:
    """Whether a measurement is a fix at the IMU: the position itself."""
    return isinstance(measurement, AntennaPosition) and measurement.lever == AT_IMU


def gnss_covariance(sigma_m: float) -> FloatArray:
    """(3, 3), m^2: of a fix with a standard deviation in east and north, and 1.5 times as much in height."""
    return np.diag(np.array([1.0, 1.0, VERTICAL**2])) * sigma_m**2
