"""Shared by the filters: initial state, assumed noise, and the interface that the localizer uses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import GRAVITY
from dohyo.sumo_networks.sensors.gnss import VERTICAL
from dohyo.sumo_networks.sensors.imu import ICM_20600, ImuNoise

CONDITIONING = 1e-12
"""Added to the covariance's diagonal at each prediction, so that it stays regular; its size is ours."""


@dataclass(frozen=True, slots=True)
class FilterNoise:
    """The noise a filter assumes, the same for all of them.

    Attributes:
        accelerometer: White noise, m/s^2 per root Hz.
        gyroscope: White noise, rad/s per root Hz.
        accelerometer_walk: Random walk of its bias, m/s^2 per root second.
        gyroscope_walk: Random walk of its bias, rad/s per root second.
    """

    accelerometer: float = ICM_20600.accelerometer_density
    gyroscope: float = ICM_20600.gyroscope_density
    accelerometer_walk: float = ICM_20600.accelerometer_walk
    gyroscope_walk: float = ICM_20600.gyroscope_walk

    @classmethod
    def of(cls, imu: ImuNoise, rate_hz: float = 100.0) -> FilterNoise:
        """Noise of an IMU, with its vibration as white noise."""
        shaken = imu.vibration / math.sqrt(rate_hz)
        return cls(
            accelerometer=math.hypot(imu.accelerometer_density, shaken),
            gyroscope=imu.gyroscope_density,
            accelerometer_walk=imu.accelerometer_walk,
            gyroscope_walk=imu.gyroscope_walk,
        )


@dataclass(frozen=True)
class InitialState:
    """Initial state of a filter, with standard deviations of each axis.

    Attributes:
        position: (3,), m, navigation frame: east, north, up.
        velocity: (3,), m/s.
        heading: rad; the vehicle is level.
        position_std: m.
        velocity_std: m/s.
        heading_std: rad.
        tilt_std: Roll and pitch, rad.
        accelerometer_bias_std: m/s^2; the bias itself starts at 0.
        gyroscope_bias_std: rad/s; likewise.
        gravity_std: m/s^2.
    """

    position: FloatArray
    velocity: FloatArray
    heading: float
    position_std: float
    velocity_std: float
    heading_std: float
    tilt_std: float = math.radians(0.05)
    accelerometer_bias_std: float = 1e-3
    gyroscope_bias_std: float = 1e-4
    gravity_std: float = 1e-3

    @property
    def gravity(self) -> FloatArray:
        """(3,), m/s^2, navigation frame."""
        return np.array([0.0, 0.0, -GRAVITY])

    def deviations(self) -> FloatArray:
        """(18,) standard deviations of position, velocity, attitude, both biases and gravity."""
        groups = [self.position_std, self.velocity_std, self.tilt_std]
        groups += [self.accelerometer_bias_std, self.gyroscope_bias_std, self.gravity_std]
        out = np.repeat(np.array(groups), 3)
        out[8] = self.heading_std
        return out


@dataclass(frozen=True, slots=True)
class Innovation:
    """Difference of a fix to the filter's expectation.

    Attributes:
        residual: (3,), m.
        covariance: (3, 3), m^2, of the residual, by the filter.
        nis: The residual's square in units of that covariance; chi-square of 3 degrees if the filter is right.
    """

    residual: FloatArray
    covariance: FloatArray
    nis: float


class Filter(Protocol):
    """A filter over IMU and GNSS.

    Attributes:
        position: (3,), m, navigation frame.
        velocity: (3,), m/s.
        heading: rad, in [-pi, pi].
        position_covariance: (3, 3), m^2.
    """

    @property
    def position(self) -> FloatArray: ...  # noqa: D102 - in the class's docstring

    @property
    def velocity(self) -> FloatArray: ...  # noqa: D102

    @property
    def heading(self) -> float: ...  # noqa: D102

    @property
    def position_covariance(self) -> FloatArray: ...  # noqa: D102

    def predict(self, specific_force: FloatArray, rate: FloatArray, dt: float) -> None:
        """Predicts over dt [s], with constant (3,) m/s^2 and (3,) rad/s in the body frame."""

    def expect(self, position: FloatArray, sigma_m: float) -> Innovation:
        """Innovation of a fix (3,) [m] with a standard deviation [m], without using it."""
        ...

    def correct(self, position: FloatArray, sigma_m: float) -> None:
        """Uses a fix."""

    def loosen(self, position_std: float, velocity_std: float, heading_std: float) -> None:
        """Raises the uncertainty of position, velocity and attitude [m, m/s, rad]."""


def gnss_covariance(sigma_m: float) -> FloatArray:
    """(3, 3), m^2: of a fix with a standard deviation in east and north, and 1.5 times as much in height."""
    return np.diag(np.array([1.0, 1.0, VERTICAL**2])) * sigma_m**2


def innovation(position: FloatArray, covariance: FloatArray, fix: FloatArray, sigma_m: float) -> Innovation:
    """Innovation of a fix, for filters with the position in their state."""
    residual, spread = fix - position, covariance + gnss_covariance(sigma_m)
    return Innovation(residual, spread, float(residual @ np.linalg.solve(spread, residual)))
