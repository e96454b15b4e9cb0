"""Standing start: calibrate the IMU at rest, then turn its track until it fits the fixes, which gives the heading.

With a heading from a map, the second phase is left out. Without a fix at rest, the first later one takes its place: the
start is that fix less the track driven before it. A wrong heading shifts this start, too; so the filter begins with a
wide uncertainty, and uses the fixes since then again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from dohyo.agents.localization.filters.attitude import from_heading, matrix
from dohyo.agents.localization.filters.base import InitialState
from dohyo.agents.localization.filters.es_ekf import integrate
from dohyo.agents.localization.filters.lowpass import LowPass
from dohyo.agents.localization.settings import Settings
from dohyo.agents.localization.starts.calibration import NONE, Calibration, calibrate
from dohyo.agents.localization.starts.rolling import HEADING_STD, KNOWN_HEADING
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import GRAVITY
from dohyo.sumo_networks.errors import InvalidInputError

Heading = tuple[float, float]
LEAST_SPEED_MPS, SIGNIFICANT = 0.5, 4.0
"""Speed by the fixes from which on a vehicle does not stand: at least so much, and so many standard deviations."""
STRAY_MPS2 = 0.5
"""Acceleration that neither the calibration nor the driver's start explains, in the comparison of both tracks."""
WIDER = 3.0
"""Factor of the uncertainty with which the filter starts where it uses the fixes of the start again: these count
1.1 times. Ours."""


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
        late: Time, position and standard deviation of the fixes that the filter has to use again; none where one came
            at rest.
    """

    settings: Settings
    heading: Heading | None
    low_pass: LowPass
    calibration: Calibration = NONE
    moved: list[tuple[FloatArray, float]] = field(default_factory=list)
    late: list[tuple[float, FloatArray, float]] = field(default_factory=list)
    _standing: bool = True
    _began: float | None = None
    _at_rest: list[FloatArray] = field(default_factory=list)
    _first_fixes: list[FloatArray] = field(default_factory=list)
    _first_times: list[float] = field(default_factory=list)
    _track: FloatArray = field(default_factory=lambda: np.zeros(19))
    _before: FloatArray = field(default_factory=lambda: np.zeros(3))
    _samples_before: int = 0

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
        return self._state(*self.heading) if self.heading is not None and self._first_fixes else None

    @property
    def least_m(self) -> float:
        """Distance from the first fix that gives the heading, m.

        After a late first fix it is as long as the track before that, so that the start is known as well as a fix, but
        not longer than a known heading takes.
        """
        sigma, before = self.settings.gnss_sigma_m, math.hypot(self._before[0], self._before[1])
        return max(self.settings.align_m, 4.0 * sigma, min(before, math.sqrt(2.0) * sigma / KNOWN_HEADING))

    def gnss(self, time: float, position: FloatArray, sigma_m: float) -> InitialState | None:
        """Uses a fix; returns the initial state once it is known.

        Raises:
            NotStandingError: The fixes moved where the IMU did not.
        """
        if self._standing:
            self._first_fixes.append(position)
            self._first_times.append(time)
            return None
        if self.late or not self._first_fixes:
            self.late.append((time, position, sigma_m))
        if not self._first_fixes:
            self._first_fixes.append(position)
            self._before, self._samples_before = self._track[:3].copy(), len(self.moved)
        if self.heading is not None:
            return self._state(*self.heading)
        away, own = position - np.mean(self._first_fixes, axis=0), self._track[:3] - self._before
        distance, drawn = math.hypot(away[0], away[1]), math.hypot(own[0], own[1])
        self._check_tracks(distance, drawn)
        if min(distance, drawn) < self.least_m:
            return None
        heading = math.atan2(away[1], away[0]) - math.atan2(own[1], own[0])
        std = math.atan2(math.sqrt(2.0) * self.settings.gnss_sigma_m, distance)
        return self._state(math.remainder(heading, 2.0 * math.pi), std)

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
        """At rest, where the first fixes were, or before them."""
        spread, measured = self.settings.standing, self.calibration.std
        # Averaging reduces only the white part of the errors, so that no reduction is assumed.
        start = InitialState(
            position=np.mean(self._first_fixes, axis=0),
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
        return self._before_late(start) if self.late else start

    def _before_late(self, start: InitialState) -> InitialState:
        """Start of a vehicle that was at the given position only when its first fix came."""
        std = start.heading_std if self.heading is not None else max(WIDER * start.heading_std, HEADING_STD)
        return replace(
            start,
            position=start.position - matrix(from_heading(start.heading)) @ self._before,
            position_std=math.hypot(WIDER * start.position_std, std * math.hypot(self._before[0], self._before[1])),
            heading_std=std,
        )

    def _check_fixes(self) -> None:
        """Refuses fixes that move while the IMU is at rest; only a start that may be another one is checked."""
        if self.settings.start != "auto" or len(self._first_fixes) < 2:
            return
        times = np.array(self._first_times) - np.mean(self._first_times)
        spread = float(times @ times)
        if spread == 0.0:
            return
        velocity = times @ np.array(self._first_fixes)[:, :2] / spread
        speed, std = float(np.hypot(*velocity)), self.settings.gnss_sigma_m / math.sqrt(spread)
        if speed > max(LEAST_SPEED_MPS, SIGNIFICANT * std):
            raise NotStandingError(f"the fixes move at {speed:.1f} m/s in the first {self.settings.standing_s:g} s")

    def _check_tracks(self, distance: float, drawn: float) -> None:
        """Refuses a start at rest if the distances by the fixes and by the IMU differ."""
        if self.settings.start != "auto":
            return
        spent = sum(dt for _, dt in self.moved[self._samples_before :])
        allowed = 6.0 * self.settings.gnss_sigma_m + 0.5 * STRAY_MPS2 * spent**2
        if distance - drawn > allowed or drawn - distance > allowed:
            raise NotStandingError(
                f"the fixes moved {distance:.0f} m while the IMU, taken as at rest before, moved {drawn:.0f} m"
            )
