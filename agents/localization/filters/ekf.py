"""EKF: the baseline. The same model, noise and start as the ES-EKF, but it estimates the full state of 19 components.

The quaternion is estimated as four numbers and normalised after each correction. filterpy is the filter; this file has
the model.
"""

from __future__ import annotations

import copy
from typing import Self

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter  # type: ignore[import-untyped]
from numba import njit

from dohyo.agents.localization.filters.attitude import exponential, heading_of, matrix, normalised, product
from dohyo.agents.localization.filters.base import (
    CONDITIONING,
    FilterNoise,
    InitialState,
    Innovation,
    innovation,
)
from dohyo.agents.localization.filters.es_ekf import (
    ACCELEROMETER,
    GYROSCOPE,
    POSITION,
    QUATERNION,
    VELOCITY,
    integrate,
    motion_of,
)
from dohyo.agents.localization.filters.measurements import Measurement
from dohyo.sumo_networks.arrays import FloatArray


class _Model(ExtendedKalmanFilter):  # type: ignore[misc]
    """filterpy's filter with the motion of an IMU instead of a linear one."""

    def predict_x(self, u: tuple[FloatArray, FloatArray, float]) -> None:
        integrate(self.x, *u)


class Ekf:
    """See the module.

    Attributes:
        filter: filterpy's; its state is (19,) position, velocity, quaternion, accelerometer bias, gyroscope bias,
            gravity.
    """

    def __init__(self, start: InitialState, noise: FilterNoise) -> None:
        self.filter = _Model(19, 3)
        state = start.nominal()
        J = _from_error_state(state[QUATERNION])
        self.filter.x = state
        self.filter.P = J @ np.diag(start.deviations() ** 2) @ J.T + CONDITIONING * np.eye(19)
        variances = [noise.accelerometer, noise.gyroscope, noise.accelerometer_walk, noise.gyroscope_walk]
        self._noise = np.array(variances) ** 2
        self._rate = np.zeros(3)

    @property
    def position(self) -> FloatArray:
        """See `Filter`."""
        return np.array(self.filter.x[POSITION])

    @property
    def velocity(self) -> FloatArray:
        """See `Filter`."""
        return np.array(self.filter.x[VELOCITY])

    @property
    def heading(self) -> float:
        """See `Filter`."""
        return float(heading_of(self.filter.x[QUATERNION]))

    @property
    def position_covariance(self) -> FloatArray:
        """See `Filter`."""
        return np.array(self.filter.P[:3, :3])

    def predict(self, specific_force: FloatArray, rate: FloatArray, dt: float) -> None:
        """See `Filter`."""
        self.filter.F, self.filter.Q = _linearised(self.filter.x, specific_force, rate, dt, self._noise)
        self.filter.predict((specific_force, rate, dt))
        self._rate = rate

    def expect(self, measurement: Measurement) -> Innovation:
        """See `Filter`."""
        motion = motion_of(self.filter.x, self._rate)
        H = measurement.jacobian(motion) @ _to_error_state(self.filter.x[QUATERNION])
        residual = measurement.value - measurement.expected(motion)
        return innovation(residual, H @ self.filter.P @ H.T + measurement.covariance)

    def correct(self, measurement: Measurement) -> None:
        """See `Filter`."""
        motion = motion_of(self.filter.x, self._rate)
        H = measurement.jacobian(motion) @ _to_error_state(self.filter.x[QUATERNION])
        expected = measurement.expected(motion)
        self.filter.update(measurement.value, lambda x: H, lambda x: expected, R=measurement.covariance)
        self.filter.x[QUATERNION] = normalised(self.filter.x[QUATERNION])

    def loosen(self, position_std: float, velocity_std: float, heading_std: float) -> None:
        """See `Filter`."""
        added = np.zeros(18)
        added[0:3], added[3:6], added[8] = position_std, velocity_std, heading_std
        J = _from_error_state(self.filter.x[QUATERNION])
        self.filter.P = self.filter.P + J @ np.diag(added**2) @ J.T

    def __copy__(self) -> Self:
        """A filter that goes on by itself from this state."""
        out = object.__new__(type(self))
        out.__dict__ = self.__dict__ | {"filter": copy.deepcopy(self.filter)}
        return out

    def scale(self, factor: float) -> None:
        """See `Filter`."""
        self.filter.P = self.filter.P * factor


@njit(cache=True)
def _half_turns(q: FloatArray) -> FloatArray:
    """(4, 3) derivative of a quaternion by a small rotation in the body frame."""
    return 0.5 * np.array([[-q[1], -q[2], -q[3]], [q[0], -q[3], q[2]], [q[3], q[0], -q[1]], [-q[2], q[1], q[0]]])


def _from_error_state(q: FloatArray) -> FloatArray:
    """(19, 18) derivative of the full state by the ES-EKF's error state."""
    out = np.zeros((19, 18))
    out[:6, :6], out[6:10, 6:9], out[10:, 9:] = np.eye(6), _half_turns(q), np.eye(9)
    return out


def _to_error_state(q: FloatArray) -> FloatArray:
    """(18, 19) derivative of the error state by the full state."""
    out = np.zeros((18, 19))
    out[:6, :6], out[6:9, 6:10], out[9:, 10:] = np.eye(6), 4.0 * _half_turns(q).T, np.eye(9)
    return out


@njit(cache=True)
def _linearised(
    state: FloatArray, specific_force: FloatArray, rate: FloatArray, dt: float, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(19, 19) the transition's Jacobian and (19, 19) the noise of a step."""
    F, Q = np.eye(19), CONDITIONING * np.eye(19)
    q, force = state[QUATERNION], specific_force - state[ACCELEROMETER]
    w, (x, y, z) = q[0], q[1:]
    # d(R(q) f) / dq, one column per component of q
    v = np.array([x, y, z])
    turned = np.cross(v, force)
    dot = v[0] * force[0] + v[1] * force[1] + v[2] * force[2]
    for i in range(3):
        F[i, 3 + i], F[3 + i, 16 + i] = dt, dt
        F[3 + i, 6] = 2.0 * dt * (w * force[i] + turned[i])
        for j in range(3):
            F[3 + i, 7 + j] = 2.0 * dt * (v[i] * force[j] - force[i] * v[j])
        F[3 + i, 7 + i] += 2.0 * dt * dot
    # - w [f]x, the part of the derivative that turns with the scalar component
    F[3, 8] += 2.0 * dt * w * force[2]
    F[3, 9] -= 2.0 * dt * w * force[1]
    F[4, 7] -= 2.0 * dt * w * force[2]
    F[4, 9] += 2.0 * dt * w * force[0]
    F[5, 7] += 2.0 * dt * w * force[1]
    F[5, 8] -= 2.0 * dt * w * force[0]
    F[VELOCITY, ACCELEROMETER] = -dt * matrix(q)
    step = exponential((rate - state[GYROSCOPE]) * dt)
    for j in range(4):
        unit = np.zeros(4)
        unit[j] = 1.0
        F[QUATERNION, 6 + j] = product(unit, step)
    half = _half_turns(q)
    F[QUATERNION, GYROSCOPE] = -dt * half
    for i in range(4):
        for j in range(4):
            for k in range(3):
                Q[6 + i, 6 + j] += noise[1] * dt * half[i, k] * half[j, k]
    for i in range(3):
        Q[3 + i, 3 + i] += noise[0] * dt
        Q[10 + i, 10 + i] += noise[2] * dt
        Q[13 + i, 13 + i] += noise[3] * dt
    return F, Q
