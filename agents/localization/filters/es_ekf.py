"""ES-EKF: an error-state extended Kalman filter of 18 states, loosely coupled.

The nominal state is integrated from the IMU without any noise; the filter estimates how wrong it is. That error is
small, so its equations are nearly linear, and the attitude's has three components where the quaternion has four. A fix
measures the error, which is then put into the nominal state and becomes zero again.

Source: Albilani's thesis, chapter 4; Sola 2017. The thesis writes the equations in continuous time; here the nominal
state is turned at the middle of each step, which removes the drift that turning at its start leaves in curves.
"""

from __future__ import annotations

from typing import Self

import numpy as np
from numba import njit

from dohyo.agents.localization.filters.attitude import (
    exponential,
    heading_of,
    matrix,
    normalised,
    product,
    skew,
)
from dohyo.agents.localization.filters.base import (
    CONDITIONING,
    FilterNoise,
    InitialState,
    Innovation,
    innovation,
)
from dohyo.agents.localization.filters.measurements import Measurement, Motion, is_plain
from dohyo.sumo_networks.arrays import FloatArray

POSITION, VELOCITY, QUATERNION = slice(0, 3), slice(3, 6), slice(6, 10)
ACCELEROMETER, GYROSCOPE, GRAVITY = slice(10, 13), slice(13, 16), slice(16, 19)
"""The nominal state; of the two instruments their biases."""
DP, DV, DT, DA, DW, DG = (slice(3 * i, 3 * i + 3) for i in range(6))
"""The error state, in the same order; the attitude's error is a rotation vector in the body frame."""


class EsEkf:
    """See the module.

    Attributes:
        nominal: (19,) position [m], velocity [m/s], quaternion, accelerometer bias [m/s^2], gyroscope bias [rad/s],
            gravity [m/s^2].
        covariance: (18, 18) of the error state.
    """

    def __init__(self, start: InitialState, noise: FilterNoise) -> None:
        self.nominal = start.nominal()
        self.covariance: FloatArray = np.diag(start.deviations() ** 2)
        variances = [noise.accelerometer, noise.gyroscope, noise.accelerometer_walk, noise.gyroscope_walk]
        self._noise = np.array(variances) ** 2
        self._rate = np.zeros(3)

    @property
    def position(self) -> FloatArray:
        """See `Filter`."""
        return self.nominal[POSITION].copy()

    @property
    def velocity(self) -> FloatArray:
        """See `Filter`."""
        return self.nominal[VELOCITY].copy()

    @property
    def heading(self) -> float:
        """See `Filter`."""
        return float(heading_of(self.nominal[QUATERNION]))

    @property
    def position_covariance(self) -> FloatArray:
        """See `Filter`."""
        return self.covariance[DP, DP].copy()

    def predict(self, specific_force: FloatArray, rate: FloatArray, dt: float) -> None:
        """See `Filter`."""
        _predict(self.nominal, self.covariance, specific_force, rate, dt, self._noise)
        self._rate = rate

    def expect(self, measurement: Measurement) -> Innovation:
        """See `Filter`."""
        if is_plain(measurement):
            spread = self.covariance[DP, DP] + measurement.covariance
            return innovation(measurement.value - self.nominal[POSITION], spread)
        motion = motion_of(self.nominal, self._rate)
        H = measurement.jacobian(motion)
        residual = measurement.value - measurement.expected(motion)
        return innovation(residual, H @ self.covariance @ H.T + measurement.covariance)

    def correct(self, measurement: Measurement) -> None:
        """See `Filter`."""
        if is_plain(measurement):
            _correct(self.nominal, self.covariance, measurement.value, measurement.covariance)
            return
        motion = motion_of(self.nominal, self._rate)
        H, P, V = measurement.jacobian(motion), self.covariance, measurement.covariance
        K = np.linalg.solve(H @ P @ H.T + V, H @ P).T
        left = np.eye(18) - K @ H
        error = K @ (measurement.value - measurement.expected(motion))
        _put_in(self.nominal, P, left @ P @ left.T + K @ V @ K.T, error)

    def loosen(self, position_std: float, velocity_std: float, heading_std: float) -> None:
        """See `Filter`."""
        diagonal = np.einsum("ii->i", self.covariance)
        diagonal[DP] += position_std**2
        diagonal[DV] += velocity_std**2
        diagonal[8] += heading_std**2

    def scale(self, factor: float) -> None:
        """See `Filter`."""
        self.covariance *= factor

    def __copy__(self) -> Self:
        """A filter that goes on by itself from this state."""
        out = object.__new__(type(self))
        out.__dict__ = self.__dict__ | {"nominal": self.nominal.copy(), "covariance": self.covariance.copy()}
        return out

    def error(self, position: FloatArray, velocity: FloatArray, quaternion: FloatArray) -> FloatArray:
        """(9,) the true error of position [m], velocity [m/s] and attitude [rad], in the sense of the error state."""
        return _error(self.nominal, position, velocity, quaternion)


def motion_of(nominal: FloatArray, rate: FloatArray) -> Motion:
    """Motion by a (19,) nominal state and the last (3,) sample of the gyroscope."""
    rotation = matrix(nominal[QUATERNION])
    return Motion(nominal[POSITION], nominal[VELOCITY], rotation, rate - nominal[GYROSCOPE])


@njit(cache=True)
def integrate(nominal: FloatArray, specific_force: FloatArray, rate: FloatArray, dt: float) -> None:
    """Integrates the (19,) nominal state in place, with an IMU sample that holds for dt [s]."""
    turn = (rate - nominal[GYROSCOPE]) * dt
    middle = matrix(product(nominal[QUATERNION], exponential(0.5 * turn)))
    acceleration = nominal[GRAVITY].copy()
    for i in range(3):
        for j in range(3):
            acceleration[i] += middle[i, j] * (specific_force[j] - nominal[10 + j])
    for i in range(3):
        nominal[i] += nominal[3 + i] * dt + 0.5 * acceleration[i] * dt * dt
        nominal[3 + i] += acceleration[i] * dt
    nominal[QUATERNION] = normalised(product(nominal[QUATERNION], exponential(turn)))


@njit(cache=True)
def transition(nominal: FloatArray, specific_force: FloatArray, rate: FloatArray, dt: float) -> FloatArray:
    """(18, 18) F_x: growth of an error of the nominal state over a step, exact to first order in dt."""
    F = np.eye(18)
    R = matrix(nominal[QUATERNION])
    F[DP, DV] = dt * np.eye(3)
    F[DV, DT] = -dt * _times(R, skew(specific_force - nominal[ACCELEROMETER]))
    F[DV, DA] = -dt * R
    F[DV, DG] = dt * np.eye(3)
    F[DT, DT] = matrix(exponential((rate - nominal[GYROSCOPE]) * dt)).T
    F[DT, DW] = -dt * np.eye(3)
    return F


@njit(cache=True)
def reset_jacobian(correction: FloatArray) -> FloatArray:
    """(3, 3) rotation of the attitude error's frame by a (3,) correction [rad] of the nominal state.

    The block of the reset's Jacobian G that is not the identity.
    """
    return np.eye(3) - 0.5 * skew(correction)


@njit(cache=True)
def _predict(
    nominal: FloatArray, P: FloatArray, specific_force: FloatArray, rate: FloatArray, dt: float, noise: FloatArray
) -> None:
    F = transition(nominal, specific_force, rate, dt)
    integrate(nominal, specific_force, rate, dt)
    # F P F^T, with only the blocks of F that are not zero: F changes the first nine rows, then the first nine columns.
    half = P.copy()
    for j in range(18):
        for i in range(3):
            half[i, j] += dt * P[3 + i, j]
            sum_v, sum_t = P[3 + i, j] + dt * P[15 + i, j], -dt * P[12 + i, j]
            for k in range(3):
                sum_v += F[3 + i, 6 + k] * P[6 + k, j] + F[3 + i, 9 + k] * P[9 + k, j]
                sum_t += F[6 + i, 6 + k] * P[6 + k, j]
            half[3 + i, j], half[6 + i, j] = sum_v, sum_t
    P[:] = half
    for i in range(18):
        for j in range(3):
            P[i, j] += dt * half[i, 3 + j]
            sum_v, sum_t = half[i, 3 + j] + dt * half[i, 15 + j], -dt * half[i, 12 + j]
            for k in range(3):
                sum_v += F[3 + j, 6 + k] * half[i, 6 + k] + F[3 + j, 9 + k] * half[i, 9 + k]
                sum_t += F[6 + j, 6 + k] * half[i, 6 + k]
            P[i, 3 + j], P[i, 6 + j] = sum_v, sum_t
    for i in range(18):
        P[i, i] += CONDITIONING
    # F_i Q_i F_i^T: impulses on velocity, attitude and the two biases; isotropic, so no rotation is needed.
    for group in range(4):
        for i in range(3 + 3 * group, 6 + 3 * group):
            P[i, i] += noise[group] * dt


@njit(cache=True)
def _correct(nominal: FloatArray, P: FloatArray, fix: FloatArray, V: FloatArray) -> None:
    PH = P[:, :3].copy()
    K = _times(PH, _inverse(P[:3, :3] + V))
    error = np.zeros(18)
    for i in range(18):
        for j in range(3):
            error[i] += K[i, j] * (fix[j] - nominal[j])
    # Joseph's form, (I - K H) P (I - K H)^T + K V K^T: symmetric and positive for any K.
    left = P - _times(K, P[:3, :].copy())
    corrected = left - _times(left[:, :3].copy(), K.T.copy()) + _times(_times(K, V), K.T.copy())
    _put_in(nominal, P, corrected, error)


@njit(cache=True)
def _put_in(nominal: FloatArray, P: FloatArray, corrected: FloatArray, error: FloatArray) -> None:
    """Puts an estimated error into the nominal state; P becomes the corrected covariance after the reset."""
    P[:] = corrected
    nominal[:6] += error[:6]
    nominal[QUATERNION] = normalised(product(nominal[QUATERNION], exponential(error[DT])))
    nominal[10:] += error[9:]
    block = reset_jacobian(error[DT])
    P[6:9, :] = _times(block, P[6:9, :].copy())
    P[:, 6:9] = _times(P[:, 6:9].copy(), block.T.copy())
    P[:] = 0.5 * (P + P.T)


@njit(cache=True)
def _error(nominal: FloatArray, position: FloatArray, velocity: FloatArray, quaternion: FloatArray) -> FloatArray:
    out = np.empty(9)
    out[:3], out[3:6] = position - nominal[POSITION], velocity - nominal[VELOCITY]
    q = nominal[QUATERNION]
    apart = product(np.array([q[0], -q[1], -q[2], -q[3]]), quaternion)
    sign = 1.0 if apart[0] >= 0.0 else -1.0
    out[6:] = 2.0 * sign * apart[1:]
    return out


@njit(cache=True)
def _times(a: FloatArray, b: FloatArray) -> FloatArray:
    """Matrix product; for these sizes faster than a call of BLAS."""
    out = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]
    return out


@njit(cache=True)
def _inverse(m: FloatArray) -> FloatArray:
    """Inverse of a (3, 3) matrix, by cofactors."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            out[i, j] = m[a, c] * m[b, d] - m[a, d] * m[b, c]
    determinant = m[0, 0] * out[0, 0] + m[0, 1] * out[1, 0] + m[0, 2] * out[2, 0]
    for i in range(3):
        for j in range(3):
            out[i, j] /= determinant
    return out
