"""UKF: the second baseline. The same model, noise and start, by sigma points; its attitude is roll, pitch and yaw.

A road vehicle is never near the angles' singularity, and yaw is not wrapped, so that the points can be averaged.
filterpy is the filter; this file has the model.
"""

from __future__ import annotations

import copy
import math
from typing import Self

import numpy as np
from filterpy.kalman import (  # type: ignore[import-untyped]
    MerweScaledSigmaPoints,
    UnscentedKalmanFilter,
    unscented_transform,
)
from numba import njit

from dohyo.agents.localization.filters.attitude import exponential, matrix
from dohyo.agents.localization.filters.base import (
    CONDITIONING,
    FilterNoise,
    InitialState,
    Innovation,
    innovation,
)
from dohyo.agents.localization.filters.measurements import Measurement, Motion, is_plain
from dohyo.sumo_networks.arrays import FloatArray

ALPHA, BETA, KAPPA = 0.1, 2.0, 0.0


class _Points(MerweScaledSigmaPoints):  # type: ignore[misc]
    """filterpy's points, all 37 by one addition."""

    def sigma_points(self, x: FloatArray, P: FloatArray) -> FloatArray:
        scale = self.alpha**2 * (self.n + self.kappa)
        roots = np.linalg.cholesky(scale * P).T
        return np.concatenate([x[None], x + roots, x - roots])


class _Model(UnscentedKalmanFilter):  # type: ignore[misc]
    """filterpy's filter, with one call for all points."""

    def compute_process_sigmas(self, dt: float, fx: object = None, **sample: FloatArray) -> None:
        points = self.points_fn.sigma_points(self.x, self.P)
        self.sigmas_f = _moved(points, sample["specific_force"], sample["rate"], dt)


class Ukf:
    """See the module.

    Attributes:
        filter: filterpy's; its state is (18,) position, velocity, roll, pitch, yaw, accelerometer bias, gyroscope
            bias, gravity.
    """

    def __init__(self, start: InitialState, noise: FilterNoise) -> None:
        points = _Points(18, ALPHA, BETA, KAPPA)
        self.filter = _Model(18, 3, 0.01, hx=lambda x: x[:3], fx=None, points=points)
        self.filter.x = np.concatenate(
            [
                start.position,
                start.velocity,
                [*start.tilt, start.heading],
                start.accelerometer_bias,
                start.gyroscope_bias,
                start.gravity,
            ]
        )
        self.filter.P = np.diag(start.deviations() ** 2)
        variances = [noise.accelerometer, noise.gyroscope, noise.accelerometer_walk, noise.gyroscope_walk]
        self._noise = np.concatenate([np.zeros(3), np.repeat(np.array(variances) ** 2, 3), np.zeros(3)])
        self._rate = np.zeros(3)

    @property
    def position(self) -> FloatArray:
        """See `Filter`."""
        return np.array(self.filter.x[:3])

    @property
    def velocity(self) -> FloatArray:
        """See `Filter`."""
        return np.array(self.filter.x[3:6])

    @property
    def heading(self) -> float:
        """See `Filter`."""
        return math.remainder(float(self.filter.x[8]), 2.0 * math.pi)

    @property
    def position_covariance(self) -> FloatArray:
        """See `Filter`."""
        return np.array(self.filter.P[:3, :3])

    def predict(self, specific_force: FloatArray, rate: FloatArray, dt: float) -> None:
        """See `Filter`."""
        self.filter.Q = np.diag(self._noise * dt + CONDITIONING)
        self.filter.predict(dt, specific_force=specific_force, rate=rate)
        self.filter.P = 0.5 * (self.filter.P + self.filter.P.T)
        self._rate = rate

    def expect(self, measurement: Measurement) -> Innovation:
        """See `Filter`."""
        if is_plain(measurement):
            return innovation(measurement.value - self.filter.x[:3], self.filter.P[:3, :3] + measurement.covariance)
        points = self.filter.points_fn
        values = np.array([self._expected(measurement, x) for x in points.sigma_points(self.filter.x, self.filter.P)])
        mean, covariance = unscented_transform(values, points.Wm, points.Wc, measurement.covariance)
        return innovation(measurement.value - mean, covariance)

    def correct(self, measurement: Measurement) -> None:
        """See `Filter`."""
        self.filter.update(measurement.value, R=measurement.covariance, hx=lambda x: self._expected(measurement, x))
        self._spread()

    def _expected(self, measurement: Measurement, x: FloatArray) -> FloatArray:
        if is_plain(measurement):
            return x[:3]
        return measurement.expected(Motion(x[:3], x[3:6], _rotation(x[6], x[7], x[8]), self._rate - x[12:15]))

    def loosen(self, position_std: float, velocity_std: float, heading_std: float) -> None:
        """See `Filter`."""
        added = np.zeros(18)
        added[0:3], added[3:6], added[8] = position_std, velocity_std, heading_std
        self.filter.P = self.filter.P + np.diag(added**2)
        self._spread()

    def __copy__(self) -> Self:
        """A filter that goes on by itself from this state."""
        out = object.__new__(type(self))
        out.__dict__ = self.__dict__ | {"filter": copy.deepcopy(self.filter)}
        return out

    def scale(self, factor: float) -> None:
        """See `Filter`."""
        self.filter.P = self.filter.P * factor
        self._spread()

    def _spread(self) -> None:
        """Draws the points anew: filterpy would correct with those of the last prediction."""
        self.filter.P = 0.5 * (self.filter.P + self.filter.P.T)
        self.filter.sigmas_f = self.filter.points_fn.sigma_points(self.filter.x, self.filter.P)


@njit(cache=True)
def _moved(points: FloatArray, specific_force: FloatArray, rate: FloatArray, dt: float) -> FloatArray:
    """(S, 18) the points after a step."""
    out = points.copy()
    for s in range(points.shape[0]):
        state = points[s]
        turn = (rate - state[12:15]) * dt
        before = _rotation(state[6], state[7], state[8])
        middle, after = before @ matrix(exponential(0.5 * turn)), before @ matrix(exponential(turn))
        for i in range(3):
            acceleration = state[15 + i]
            for j in range(3):
                acceleration += middle[i, j] * (specific_force[j] - state[9 + j])
            out[s, i] += state[3 + i] * dt + 0.5 * acceleration * dt * dt
            out[s, 3 + i] += acceleration * dt
        out[s, 6] = math.atan2(after[2, 1], after[2, 2])
        out[s, 7] = math.asin(min(max(-after[2, 0], -1.0), 1.0))
        yaw = math.atan2(after[1, 0], after[0, 0])
        out[s, 8] = yaw + 2.0 * math.pi * round((state[8] - yaw) / (2.0 * math.pi))
    return out


@njit(cache=True)
def _rotation(roll: float, pitch: float, yaw: float) -> FloatArray:
    """(3, 3) body to navigation frame."""
    cr, sr, cp, sp, cy, sy = (
        math.cos(roll),
        math.sin(roll),
        math.cos(pitch),
        math.sin(pitch),
        math.cos(yaw),
        math.sin(yaw),
    )
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
