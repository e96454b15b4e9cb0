"""Shared by the filters: initial state, assumed noise, and the interface that the localizer uses."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Protocol

import numpy as np
from pydantic import Field

from dohyo.agents.localization.filters.attitude import exponential, from_heading, normalised, product
from dohyo.agents.localization.filters.measurements import Measurement
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.ego.dynamics import GRAVITY
from dohyo.sumo_networks.sensors.imu import ICM_20600, ImuNoise

Positive = Annotated[float, Field(gt=0.0)]

CONDITIONING = 1e-12
"""Added to the covariance's diagonal at each prediction, so that it stays regular; its size is ours."""


class FilterNoise(Config):
    """Noise of an IMU that a filter assumes, the same for all filters.

    Attributes:
        accelerometer: White noise, m/s^2 per root Hz.
        gyroscope: White noise, rad/s per root Hz.
        accelerometer_walk: Random walk of its bias, m/s^2 per root second.
        gyroscope_walk: Random walk of its bias, rad/s per root second.
    """

    accelerometer: Positive = ICM_20600.accelerometer_density
    gyroscope: Positive = ICM_20600.gyroscope_density
    accelerometer_walk: Positive = ICM_20600.accelerometer_walk
    gyroscope_walk: Positive = ICM_20600.gyroscope_walk

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
        heading: rad.
        position_std: m.
        velocity_std: m/s.
        heading_std: rad.
        tilt_std: Roll and pitch, rad.
        accelerometer_bias_std: m/s^2.
        gyroscope_bias_std: rad/s.
        gravity_std: m/s^2.
        tilt: Roll and pitch, rad; the vehicle is level by default.
        accelerometer_bias: (3,), m/s^2.
        gyroscope_bias: (3,), rad/s.
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
    tilt: tuple[float, float] = (0.0, 0.0)
    accelerometer_bias: FloatArray = field(default_factory=lambda: np.zeros(3))
    gyroscope_bias: FloatArray = field(default_factory=lambda: np.zeros(3))

    @property
    def gravity(self) -> FloatArray:
        """(3,), m/s^2, navigation frame."""
        return np.array([0.0, 0.0, -GRAVITY])

    def nominal(self) -> FloatArray:
        """(19,) position, velocity, quaternion, both biases and gravity: the nominal state of the ES-EKF."""
        quaternion = from_heading(self.heading)
        if self.tilt != (0.0, 0.0):
            quaternion = normalised(product(quaternion, exponential(np.array([*self.tilt, 0.0]))))
        biases = self.accelerometer_bias, self.gyroscope_bias
        return np.concatenate([self.position, self.velocity, quaternion, *biases, self.gravity])

    def deviations(self) -> FloatArray:
        """(18,) standard deviations of position, velocity, attitude, both biases and gravity."""
        groups = [self.position_std, self.velocity_std, self.tilt_std]
        groups += [self.accelerometer_bias_std, self.gyroscope_bias_std, self.gravity_std]
        out = np.repeat(np.array(groups), 3)
        out[8] = self.heading_std
        return out


@dataclass(frozen=True, slots=True)
class Innovation:
    """Difference of a measurement to the filter's expectation.

    Attributes:
        residual: (m,); of a fix in m.
        covariance: (m, m) of the residual, by the filter.
        nis: The residual's square in units of that covariance; chi-square of m degrees if the filter is right.
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

    def expect(self, measurement: Measurement) -> Innovation:
        """Innovation of a measurement, without using it."""
        ...

    def correct(self, measurement: Measurement) -> None:
        """Uses a measurement."""

    def loosen(self, position_std: float, velocity_std: float, heading_std: float) -> None:
        """Raises the uncertainty of position, velocity and attitude [m, m/s, rad]."""

    def scale(self, factor: float) -> None:
        """Multiplies the covariance of the whole state, its biases included."""


def innovation(residual: FloatArray, covariance: FloatArray) -> Innovation:
    """Innovation by a residual and its covariance."""
    return Innovation(residual, covariance, float(residual @ np.linalg.solve(covariance, residual)))
