"""Rolling start: position, velocity, attitude and biases at the first fix, by a fit of the first fixes.

The IMU's samples are integrated from the first fix on; the fit finds the initial state for which this path meets the
fixes, with priors: a car moves along its heading, roads are nearly level, biases are as large as the settings say. Wild
fixes, the first one too, count little (soft L1), and the fit is believed once most fixes lie on its path. The filter
then starts at the time of the first fix, around the fitted state but with the uncertainty before the fit, and uses the
same fixes: so none counts twice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from scipy.optimize import least_squares  # type: ignore[import-untyped]

from dohyo.agents.localization.filters.attitude import exponential, from_heading, matrix, normalised, product
from dohyo.agents.localization.filters.base import InitialState
from dohyo.agents.localization.filters.es_ekf import integrate
from dohyo.agents.localization.settings import Settings
from dohyo.sumo_networks.arrays import ComplexArray, FloatArray, IntArray
from dohyo.sumo_networks.ego.dynamics import GRAVITY
from dohyo.sumo_networks.sensors.gnss import VERTICAL

LEAST_FIXES, ENOUGH_FIXES = 4, 6
"""Fixes for a fit, since one wild fix among three cannot be recognised; and for a start in spite of doubts."""
LEAST_AGREEING, AGREEING_SHARE, AGREEING_SIGMAS = 3, 0.7, 4.0
"""Fixes that must lie on the fitted path: number, share, and distance in standard deviations."""
MOST_TRIED = 24
"""Fixes of which each pair gives a first guess."""
KNOWN_HEADING, HEADING_STD = 0.1, 0.25
"""Standard deviation of the fitted heading at which the filter starts, and of the heading in the filter, rad."""
LONG_S = 20.0
"""Length of a window after which the filter starts with a heading that is known less well, and after which a vehicle
that has not moved begins a new window."""
LEVEL, LEVEL_EVERY_S = 0.15, 1.0
"""Standard deviation of roll and pitch in the fit, each second; consecutive seconds are of one road, hence so large."""
TRIED_EVERY_S = 1.0


@dataclass
class RollingStart:
    """Collects samples and fixes until the heading is known.

    Attributes:
        settings: Of the localizer.
        times: Of the samples since the first fix, s.
        samples: (6,) each, after the low-pass filter.
        steps: Time that each sample holds, s.
        fixes: Time, position and standard deviation.
    """

    settings: Settings
    times: list[float] = field(default_factory=list)
    samples: list[FloatArray] = field(default_factory=list)
    steps: list[float] = field(default_factory=list)
    fixes: list[tuple[float, FloatArray, float]] = field(default_factory=list)
    _tried: float = -math.inf

    def imu(self, time: float, sample: FloatArray, dt: float) -> None:
        """Keeps a sample, from the first fix on."""
        if self.fixes:
            self.times.append(time)
            self.samples.append(sample)
            self.steps.append(min(dt, time - self.fixes[0][0]))

    def gnss(self, time: float, position: FloatArray, sigma_m: float) -> InitialState | None:
        """Uses a fix; returns the state at the first fix of the window once the heading is known."""
        self.fixes.append((time, position, sigma_m))
        if len(self.fixes) < LEAST_FIXES or time - self._tried < TRIED_EVERY_S or not self.samples:
            return None
        distance = self._distance()
        sigma = float(np.median([fix[2] for fix in self.fixes]))
        if distance < max(self.settings.align_m, 4.0 * sigma):
            if time - self.fixes[0][0] > LONG_S and len(self.fixes) > ENOUGH_FIXES:
                self._forget()
            return None
        self._tried = time
        state, heading_std, agreeing = self._fit()
        agreed = agreeing >= max(LEAST_AGREEING, AGREEING_SHARE * len(self.fixes))
        enough = len(self.fixes) >= ENOUGH_FIXES and time - self.fixes[0][0] > LONG_S
        return state if (agreed and heading_std < KNOWN_HEADING) or enough else None

    def _distance(self) -> float:
        """Distance from the beginning, m; one wild fix, the first one too, is no motion."""
        places = np.array([fix[1][:2] for fix in self.fixes])
        apart = np.linalg.norm(places[:LEAST_AGREEING, None] - places[None], axis=2)
        begin = int(np.argmin(apart[:, :LEAST_AGREEING].sum(axis=1)))
        return float(np.median(np.sort(apart[begin])[-3:]))

    def _forget(self) -> None:
        """Begins the window at a later fix."""
        self.fixes = self.fixes[len(self.fixes) // 2 :]
        first = int(np.searchsorted(self.times, self.fixes[0][0], side="right"))
        self.times, self.samples, self.steps = self.times[first:], self.samples[first:], self.steps[first:]

    def _fit(self) -> tuple[InitialState, float, int]:
        """Fitted state at the first fix, the standard deviation of its heading, and the number of fixes that agree."""
        problem = _Problem.of(self)
        found = least_squares(
            problem.residuals, problem.guess(), loss="soft_l1", x_scale=problem.spread, max_nfev=40, method="trf"
        )
        x, spread = found.x, self.settings.rolling
        information = found.jac.T @ found.jac
        std = np.sqrt(np.diag(np.linalg.pinv(information, hermitian=True)))
        sigma = float(np.median(problem.sigma))
        rotation = matrix(_attitude(x))
        state = InitialState(
            position=x[0:3] + problem.origin,
            velocity=rotation @ x[3:6],
            heading=math.remainder(float(x[8]), 2.0 * math.pi),
            position_std=3.0 * sigma,
            velocity_std=spread.velocity,
            heading_std=HEADING_STD,
            tilt_std=spread.tilt,
            accelerometer_bias_std=spread.accelerometer_bias,
            gyroscope_bias_std=spread.gyroscope_bias,
            tilt=(float(x[6]), float(x[7])),
            accelerometer_bias=x[9:12].copy(),
            gyroscope_bias=x[12:15].copy(),
        )
        return state, float(std[8]), problem.agreeing(x)


@dataclass(frozen=True)
class _Problem:
    """The fit of one window.

    The unknowns are the position from `origin` [m], the velocity in the body frame [m/s], roll, pitch and heading
    [rad], and the biases of accelerometer [m/s^2] and gyroscope [rad/s] at the first fix.

    Attributes:
        samples: (N, 6) of the IMU.
        steps: (N,), s.
        rows: (K,) number of samples before each fix.
        level_rows: (L,) number of samples before each comparison with a level road.
        fixes: (K, 3), m, from `origin`.
        sigma: (K,) standard deviations of the fixes, those of the integration included, m.
        spread: (15,) standard deviations of the unknowns before the fit.
        origin: (3,) the first fix, m.
    """

    samples: FloatArray
    steps: FloatArray
    rows: IntArray
    level_rows: IntArray
    fixes: FloatArray
    sigma: FloatArray
    spread: FloatArray
    origin: FloatArray

    @classmethod
    def of(cls, start: RollingStart) -> _Problem:
        """Problem of the window so far."""
        settings, spread = start.settings, start.settings.rolling
        times = np.array(start.times)
        fix_times = np.array([fix[0] for fix in start.fixes])
        positions = np.array([fix[1] for fix in start.fixes])
        since = fix_times - fix_times[0]
        # White noise of the accelerometer, integrated twice, is no error of the initial state.
        drift = settings.noise.accelerometer * since**1.5 / math.sqrt(3.0)
        level_times = np.arange(fix_times[0], times[-1], LEVEL_EVERY_S)
        groups = [(3.0 * start.fixes[0][2], 3), (30.0, 1), (spread.sideways, 2), (spread.tilt, 2), (math.pi, 1)]
        groups += [(spread.accelerometer_bias, 3), (spread.gyroscope_bias, 3)]
        return cls(
            samples=np.array(start.samples),
            steps=np.array(start.steps),
            rows=np.searchsorted(times, fix_times + 1e-6, side="right"),
            level_rows=np.searchsorted(times, level_times, side="right"),
            fixes=positions - positions[0],
            sigma=np.hypot([fix[2] for fix in start.fixes], drift),
            spread=np.concatenate([np.full(count, std) for std, count in groups]),
            origin=positions[0],
        )

    def guess(self) -> FloatArray:
        """Unknowns for a constant speed along the gyroscope's heading, turned and shifted to most of the fixes."""
        heading = np.cumsum(self.samples[:, 5] * self.steps)
        path = np.cumsum(np.exp(1j * heading) * self.steps)
        path = np.concatenate([[0.0], path])[self.rows]
        fixes = self.fixes[:, 0] + 1j * self.fixes[:, 1]
        weight = 1.0 / (self.sigma**2 * (1.0 + self._best_of_pairs(path, fixes) ** 2))
        a, b = (points - np.average(points, weights=weight) for points in (path, fixes))
        turn = complex(np.sum(weight * np.conj(a) * b) / max(float(np.sum(weight * np.abs(a) ** 2)), 1e-9))
        begin = complex(np.average(fixes - turn * path, weights=weight))
        out = np.zeros(15)
        out[0], out[1], out[3], out[8] = begin.real, begin.imag, abs(turn), math.atan2(turn.imag, turn.real)
        return out

    def _best_of_pairs(self, path: ComplexArray, fixes: ComplexArray) -> FloatArray:
        """(K,) distances of the fixes, in standard deviations, from the path through two of them that suits most."""
        tried = np.unique(np.linspace(0, len(fixes) - 1, min(len(fixes), MOST_TRIED)).astype(int))
        i, j = (tried[side] for side in np.triu_indices(len(tried), 1))
        moved = path[j] - path[i]
        i, j, moved = (values[np.abs(moved) > 1e-6] for values in (i, j, moved))
        if not len(moved):
            return np.zeros(len(fixes))
        turn = (fixes[j] - fixes[i]) / moved
        away = np.abs(fixes - fixes[i, None] - turn[:, None] * (path - path[i, None])) / self.sigma
        return np.asarray(away[np.argmin(np.log1p(away**2).sum(axis=1))])

    def agreeing(self, x: FloatArray) -> int:
        """Number of fixes that lie on the path of the unknowns, in the plane."""
        positions, _ = _path(_nominal(x), self.samples, self.steps, self.rows, self.level_rows)
        away = np.linalg.norm((positions - self.fixes)[:, :2], axis=1) / self.sigma
        return int(np.count_nonzero(away < AGREEING_SIGMAS))

    def residuals(self, x: FloatArray) -> FloatArray:
        """All in standard deviations."""
        positions, tilts = _path(_nominal(x), self.samples, self.steps, self.rows, self.level_rows)
        off = (positions - self.fixes) / (self.sigma[:, None] * np.array([1.0, 1.0, VERTICAL]))
        prior = x / self.spread
        prior[[0, 1, 2, 3, 8]] = 0.0  # place, forward speed and heading are unknown; the first fix is one of all
        return np.concatenate([off.ravel(), (tilts / LEVEL).ravel(), prior])


def _attitude(x: FloatArray) -> FloatArray:
    """(4,) quaternion of the unknowns."""
    tilt = exponential(np.array([x[6], x[7], 0.0]))
    return np.asarray(normalised(product(from_heading(x[8]), tilt)))


def _nominal(x: FloatArray) -> FloatArray:
    """(19,) nominal state of the unknowns."""
    quaternion = _attitude(x)
    return np.concatenate([x[0:3], matrix(quaternion) @ x[3:6], quaternion, x[9:15], [0.0, 0.0, -GRAVITY]])


@njit(cache=True)
def _path(
    nominal: FloatArray, samples: FloatArray, steps: FloatArray, rows: IntArray, level_rows: IntArray
) -> tuple[FloatArray, FloatArray]:
    """(K, 3) positions after so many samples, and (L, 2) sines of the tilt after so many."""
    positions, tilts = np.empty((len(rows), 3)), np.empty((len(level_rows), 2))
    k, m = 0, 0
    for n in range(len(samples) + 1):
        while k < len(rows) and rows[k] <= n:
            positions[k] = nominal[:3]
            k += 1
        while m < len(level_rows) and level_rows[m] <= n:
            R = matrix(nominal[6:10])
            tilts[m, 0], tilts[m, 1] = R[2, 0], R[2, 1]
            m += 1
        if n < len(samples):
            integrate(nominal, samples[n, :3], samples[n, 3:], steps[n])
    return positions, tilts
