"""Localizer: from the raw samples of an IMU and a GNSS receiver to a pose. Calibrate, align, low-pass, filter.

There are three phases. *Standing*: the IMU is calibrated and the fixes are averaged. *Aligning*: the vehicle sets off,
and the IMU's track is turned until it fits the fixes, which gives the heading. *Running*: the filter, from the moment
at which the vehicle set off. With a heading from a map, the second phase is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from dohyo.agents.localization.calibration import NONE, Calibration, calibrate
from dohyo.agents.localization.es_ekf import EsEkf, integrate
from dohyo.agents.localization.filters import Filter, FilterNoise, InitialState, Innovation
from dohyo.agents.localization.lowpass import ALPHA, LowPass
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import GRAVITY
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError


def _ekf(start: InitialState, noise: FilterNoise) -> Filter:
    from dohyo.agents.localization.ekf import Ekf  # filterpy takes a second to import; most uses need only the ES-EKF

    return Ekf(start, noise)


def _ukf(start: InitialState, noise: FilterNoise) -> Filter:
    from dohyo.agents.localization.ukf import Ukf

    return Ukf(start, noise)


FILTERS: Mapping[str, Callable[[InitialState, FilterNoise], Filter]] = MappingProxyType(
    {"es-ekf": EsEkf, "ekf": _ekf, "ukf": _ukf, "imu": EsEkf}
)
"""Filters by name; "imu" is dead reckoning, which uses no fix once it runs."""

GATE = 21.1
"""NIS above which a fix is an outlier: one in 10 000 for a correct filter (chi-square, 3 degrees)."""
PATIENCE = 5
"""Number of consecutive outliers after which the fixes are believed."""
MAX_STEP_S = 0.1
"""Length of a gap in the IMU's samples above which the uncertainty is raised, s."""
BLIND_ACCELERATION, BLIND_YAW_RATE = 3.0, 0.3
"""Motion of a car during a gap, standard deviations, m/s^2 and rad/s."""


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of a localizer.

    Attributes:
        filter: A name of `FILTERS`.
        calibrate: Whether to measure the IMU's offsets at rest; otherwise none are subtracted.
        alpha: Coefficient of the low-pass filter; 0: none.
        standing_s: Standing time at the start.
        gnss_sigma_m: Assumed error of the receiver.
        noise: Assumed noise of the IMU.
        align_m: Distance that gives the heading; at least 4 sigma.
        gate: Whether to leave out outliers among the fixes.
    """

    filter: str = "es-ekf"
    calibrate: bool = True
    alpha: float = ALPHA
    standing_s: float = 3.0
    gnss_sigma_m: float = 2.1
    noise: FilterNoise = field(default_factory=FilterNoise)
    align_m: float = 5.0
    gate: bool = True


@dataclass(frozen=True)
class Fix:
    """Fix of the GNSS receiver.

    Attributes:
        time: s.
        position: (3,), m, navigation frame.
    """

    time: float
    position: FloatArray


class Localizer:
    """Estimates the pose of one vehicle on one journey that begins at rest on level ground.

    Attributes:
        settings: Of the localizer.
        calibration: Offsets measured at rest; none before.
        filter: The running filter; None while standing or aligning.
        aligned_at: Start of the filter, s; NaN before.
        innovations: Of every fix since the filter runs, outliers included.
        rejected: Number of outliers among them.
    """

    def __init__(self, settings: Settings | None = None, heading: tuple[float, float] | None = None) -> None:
        """Prepares for a journey.

        Args:
            settings: Of the localizer.
            heading: Heading with its standard deviation, rad, if known.

        Raises:
            InvalidInputError: A setting is impossible.
        """
        self.settings = settings or Settings()
        if self.settings.filter not in FILTERS:
            raise UnknownNameError("filter", self.settings.filter, FILTERS)
        if not self.settings.gnss_sigma_m > 0.0:
            raise InvalidInputError(f"localizer: expected a GNSS sigma above 0 m, got {self.settings.gnss_sigma_m}")
        self.calibration: Calibration = NONE
        self.filter: Filter | None = None
        self.aligned_at = math.nan
        self.innovations: list[Innovation] = []
        self.rejected = 0
        self._heading = heading
        self._low_pass = LowPass(self.settings.alpha)
        self._time: float | None = None
        self._began = math.nan
        self._standing = True
        self._at_rest: list[FloatArray] = []
        self._fixes_at_rest: list[FloatArray] = []
        self._moved: list[tuple[FloatArray, float]] = []
        self._track = np.zeros(19)
        self._outliers = 0

    def imu(self, time: float, sample: FloatArray) -> None:
        """Uses a sample that holds for the time since the last one.

        Args:
            time: s; a sample that is not later than the last one is ignored.
            sample: (6,) specific force [m/s^2] and angular rate [rad/s], body frame (x forward, y left, z up).

        Raises:
            InvalidInputError: The vehicle did not stand still during the calibration.
        """
        if self._time is None:
            self._began = self._time = time
        elif time <= self._time:
            return
        dt, self._time = time - self._time, time
        if self._standing:
            self._at_rest.append(sample)
            if time - self._began >= self.settings.standing_s:
                self._set_off()
            return
        sample = self._low_pass.step(self.calibration.apply(sample))
        if self.filter is not None:
            self._predict(self.filter, sample, dt)
        else:
            self._moved.append((sample, dt))
            integrate(self._track, sample[:3], sample[3:], dt)

    def gnss(self, time: float, position: FloatArray) -> None:
        """Uses a fix, at the time of the last IMU sample.

        Args:
            time: s.
            position: (3,) east, north, up [m].
        """
        if not np.isfinite(position).all():
            return
        if self.filter is not None:
            self._correct(position)
        elif self._standing:
            self._fixes_at_rest.append(position)
        else:
            self._try_to_align(position, time)

    @property
    def pose(self) -> tuple[float, float, float] | None:
        """East, north [m] and heading [rad]; None before the filter runs."""
        if self.filter is None:
            return None
        east, north, _ = self.filter.position.tolist()
        return east, north, self.filter.heading

    def _set_off(self) -> None:
        """Ends the standing phase."""
        if self.settings.calibrate:
            self.calibration = calibrate(np.array(self._at_rest))
        self._standing = False
        self._track[6], self._track[18] = 1.0, -GRAVITY
        if self._heading is not None and self._fixes_at_rest:
            self._start(*self._heading)

    def _try_to_align(self, position: FloatArray, time: float) -> None:
        """Starts the filter once fixes and IMU's track have moved far enough."""
        sigma = self.settings.gnss_sigma_m
        if not self._fixes_at_rest:
            self._fixes_at_rest.append(position)  # the first fix came late: use it as the start
            return
        if self._heading is not None:
            self._start(*self._heading)
            return
        away = position - np.mean(self._fixes_at_rest, axis=0)
        distance, drawn = math.hypot(away[0], away[1]), math.hypot(self._track[0], self._track[1])
        if min(distance, drawn) < max(self.settings.align_m, 4.0 * sigma):
            return
        heading = math.atan2(away[1], away[0]) - math.atan2(self._track[1], self._track[0])
        self._start(math.remainder(heading, 2.0 * math.pi), math.atan2(math.sqrt(2.0) * sigma, distance))

    def _start(self, heading: float, heading_std: float) -> None:
        """Starts the filter at rest, and repeats the samples since then."""
        settings, calibration = self.settings, self.calibration
        start = InitialState(
            position=np.mean(self._fixes_at_rest, axis=0),
            velocity=np.zeros(3),
            heading=heading,
            # Averaging reduces only the white part of the errors, so that no reduction is assumed.
            position_std=settings.gnss_sigma_m,
            velocity_std=0.05,
            heading_std=max(heading_std, 1e-3),
        )
        if settings.calibrate:
            force, rate = float(calibration.std[:3].max()), float(calibration.std[3:].max())
            start = replace(
                start,
                accelerometer_bias_std=max(force, start.accelerometer_bias_std),
                gyroscope_bias_std=max(rate, start.gyroscope_bias_std),
            )
        self.filter = FILTERS[settings.filter](start, settings.noise)
        for sample, dt in self._moved:
            self._predict(self.filter, sample, dt)
        self._moved.clear()
        self.aligned_at = self._time if self._time is not None else math.nan

    def _predict(self, filter_: Filter, sample: FloatArray, dt: float) -> None:
        steps = max(1, math.ceil(dt / MAX_STEP_S))
        for _ in range(steps):
            filter_.predict(sample[:3], sample[3:], dt / steps)
        if steps > 1:
            filter_.loosen(0.5 * BLIND_ACCELERATION * dt * dt, BLIND_ACCELERATION * dt, BLIND_YAW_RATE * dt)

    def _correct(self, position: FloatArray) -> None:
        filter_, sigma = self.filter, self.settings.gnss_sigma_m
        if filter_ is None or self.settings.filter == "imu":
            return
        innovation = filter_.expect(position, sigma)
        self.innovations.append(innovation)
        if self.settings.gate and innovation.nis > GATE:
            self.rejected += 1
            self._outliers += 1
            if self._outliers < PATIENCE:
                return
            # The filter was overconfident: raise its uncertainty, so that this fix moves it.
            off = float(np.linalg.norm(innovation.residual))
            filter_.loosen(off, min(off, 5.0), 0.2)
        self._outliers = 0
        filter_.correct(position, sigma)
