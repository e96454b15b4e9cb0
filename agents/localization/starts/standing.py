"""Standing start: calibrate the IMU at rest, then turn its track until it fits the fixes, which gives the heading.

With a heading from a map, the second phase is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from dohyo.agents.localization.filters.base import InitialState
from dohyo.agents.localization.filters.es_ekf import integrate
from dohyo.agents.localization.filters.lowpass import LowPass
from dohyo.agents.localization.settings import Settings
from dohyo.agents.localization.starts.calibration import NONE, Calibration, calibrate
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import GRAVITY
from dohyo.sumo_networks.errors import InvalidInputError

Heading = tuple[float, float]
LEAST_SPEED_MPS, SIGNIFICANT = 0.5, 4.0
"""Speed by the fixes from which on a vehicle does not stand: at least so much, and so many standard deviations."""
STRAY_MPS2 = 0.5
"""Acceleration that neither the calibration nor the driver's start explains, in the comparison of both tracks."""


class NotStandingError(InvalidInputError):
    """The vehicle did not stand at first, by its IMU or by its fixes."""


@dataclass
class StandingStart:
    """Collects samples and fixes until the heading is known.

    Attributes:
        settings: Of the localizer.
        heading: Heading with its standard deviation, rad, if known.
        low_pass: Filter of the IMU's samples after the calibration.
        calibration: Offsets measured at rest; none before.
        moved: Calibrated samples and time steps since the vehicle set off.
    """

    settings: Settings
    heading: Heading | None
    low_pass: LowPass
    calibration: Calibration = NONE
    moved: list[tuple[FloatArray, float]] = field(default_factory=list)
    _standing: bool = True
    _began: float | None = None
    _at_rest: list[FloatArray] = field(default_factory=list)
    _fixes_at_rest: list[FloatArray] = field(default_factory=list)
    _times_at_rest: list[float] = field(default_factory=list)
    _track: FloatArray = field(default_factory=lambda: np.zeros(19))

    def imu(self, time: float, sample: FloatArray, dt: float) -> InitialState | None:
        """Uses a sample; returns the initial state once it is known.

        Raises:
            NotStandingError: The vehicle did not stand still.
        """
        self._began = time if self._began is None else self._began
        if not self._standing:
            sample = self.low_pass.step(self.calibration.apply(sample))
            self.moved.append((sample, dt))
            integrate(self._track, sample[:3], sample[3:], dt)
            return None
        self._at_rest.append(sample)
        if time - self._began < self.settings.standing_s:
            return None
        self._set_off()
        return self._state(*self.heading) if self.heading is not None and self._fixes_at_rest else None

    def gnss(self, time: float, position: FloatArray) -> InitialState | None:
        """Uses a fix; returns the initial state once it is known.

        Raises:
            NotStandingError: The fixes moved where the IMU did not.
        """
        if self._standing or not self._fixes_at_rest:  # the first fix may come late: it is the start
            self._fixes_at_rest.append(position)
            self._times_at_rest.append(time)
            return None
        if self.heading is not None:
            return self._state(*self.heading)
        sigma = self.settings.gnss_sigma_m
        away = position - np.mean(self._fixes_at_rest, axis=0)
        distance, drawn = math.hypot(away[0], away[1]), math.hypot(self._track[0], self._track[1])
        self._check_tracks(distance, drawn)
        if min(distance, drawn) < max(self.settings.align_m, 4.0 * sigma):
            return None
        heading = math.atan2(away[1], away[0]) - math.atan2(self._track[1], self._track[0])
        return self._state(math.remainder(heading, 2.0 * math.pi), math.atan2(math.sqrt(2.0) * sigma, distance))

    def _set_off(self) -> None:
        """Ends the standing phase."""
        self._check_fixes()
        if self.settings.calibrate:
            try:
                self.calibration = calibrate(np.array(self._at_rest))
            except InvalidInputError as error:
                raise NotStandingError(str(error)) from error
        self._standing = False
        self._track[6], self._track[18] = 1.0, -GRAVITY

    def _state(self, heading: float, heading_std: float) -> InitialState:
        """At rest, where the fixes of the standing phase were."""
        spread, measured = self.settings.standing, self.calibration.std
        # Averaging reduces only the white part of the errors, so that no reduction is assumed.
        return InitialState(
            position=np.mean(self._fixes_at_rest, axis=0),
            velocity=np.zeros(3),
            heading=heading,
            position_std=self.settings.gnss_sigma_m,
            velocity_std=spread.velocity,
            heading_std=max(heading_std, 1e-3),
            tilt_std=spread.tilt,
            accelerometer_bias_std=max(float(measured[:3].max()), spread.accelerometer_bias),
            gyroscope_bias_std=max(float(measured[3:].max()), spread.gyroscope_bias),
            gravity_std=spread.gravity,
        )

    def _check_fixes(self) -> None:
        """Refuses fixes that move while the IMU is at rest; only a start that may be another one is checked."""
        if self.settings.start != "auto" or len(self._fixes_at_rest) < 2:
            return
        times = np.array(self._times_at_rest) - np.mean(self._times_at_rest)
        spread = float(times @ times)
        if spread == 0.0:
            return
        velocity = times @ np.array(self._fixes_at_rest)[:, :2] / spread
        speed, std = float(np.hypot(*velocity)), self.settings.gnss_sigma_m / math.sqrt(spread)
        if speed > max(LEAST_SPEED_MPS, SIGNIFICANT * std):
            raise NotStandingError(f"the fixes move at {speed:.1f} m/s in the first {self.settings.standing_s:g} s")

    def _check_tracks(self, distance: float, drawn: float) -> None:
        """Refuses a start at rest if the distances by the fixes and by the IMU differ."""
        if self.settings.start != "auto":
            return
        spent = sum(dt for _, dt in self.moved)
        allowed = 6.0 * self.settings.gnss_sigma_m + 0.5 * STRAY_MPS2 * spent**2
        if distance - drawn > allowed or drawn - distance > allowed:
            raise NotStandingError(
                f"the fixes moved {distance:.0f} m while the IMU, taken as at rest before, moved {drawn:.0f} m"
            )
