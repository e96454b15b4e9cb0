"""Localizer: from the raw samples of an IMU and a GNSS receiver to a pose. Start, low-pass, filter.

A journey begins at rest (`starts.standing`) or rolling (`starts.rolling`). Then the filter runs, from the moment at
which the vehicle set off, or from the first fix of a rolling start.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import wraps
from types import MappingProxyType
from typing import Concatenate, ParamSpec

import numpy as np

from dohyo.agents.localization.filters.base import Filter, FilterNoise, InitialState
from dohyo.agents.localization.filters.es_ekf import EsEkf
from dohyo.agents.localization.filters.lowpass import LowPass
from dohyo.agents.localization.filters.measurements import AntennaPosition, LevelRoad, PointVelocity
from dohyo.agents.localization.outliers import CORRECTORS, Corrector, JudgedFix
from dohyo.agents.localization.settings import Settings
from dohyo.agents.localization.smoother import RecordedEsEkf
from dohyo.agents.localization.starts.calibration import NONE, Calibration
from dohyo.agents.localization.starts.rolling import RollingStart
from dohyo.agents.localization.starts.standing import NotStandingError, StandingStart
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError


def _ekf(start: InitialState, noise: FilterNoise) -> Filter:
    # Filterpy takes a second to import; most uses need only the ES-EKF.
    from dohyo.agents.localization.filters.ekf import Ekf

    return Ekf(start, noise)


def _ukf(start: InitialState, noise: FilterNoise) -> Filter:
    from dohyo.agents.localization.filters.ukf import Ukf

    return Ukf(start, noise)


FILTERS: Mapping[str, Callable[[InitialState, FilterNoise], Filter]] = MappingProxyType(
    {"es-ekf": EsEkf, "ekf": _ekf, "ukf": _ukf, "imu": EsEkf}
)
"""Filters by name; "imu" is dead reckoning, which uses no fix once it runs."""

MAX_STEP_S = 0.1
"""Longest step of the integration, s; a longer one is split."""
SLOWEST_STEP_S = 0.2
"""Time between two samples of the slowest IMU, s."""
GAP_S = 1.5 * SLOWEST_STEP_S
"""Length of a gap in the IMU's samples above which the uncertainty is raised, s; the slowest IMU stays below it."""
BLIND_ACCELERATION, BLIND_YAW_RATE = 3.0, 0.3
"""Motion of a car during a gap, standard deviations, m/s^2 and rad/s."""
SAME_TIME_S = 1e-6

P = ParamSpec("P")


class FilterDivergedError(InvalidInputError):
    """The filter's state or covariance is no longer a number: the measurements contradict what it assumes."""

    def __init__(self, time: float, settings: Settings, cause: object) -> None:
        """Says when it happened, and with which policy.

        Args:
            time: Of the sample or fix, s.
            settings: Of the localizer.
            cause: What the arithmetic says.
        """
        super().__init__(
            f"localizer: expected measurements that fit the settings; at {time:.2f} s the filter {settings.filter} "
            f"with the outlier policy {settings.outliers} diverged ({cause})"
        )


@dataclass(frozen=True)
class Fix:
    """Fix of the GNSS receiver.

    Attributes:
        time: s.
        position: (3,), m, navigation frame.
        sigma_m: Standard deviation in east and north by the receiver; None: that of the settings.
    """

    time: float
    position: FloatArray
    sigma_m: float | None = None


def _tells_divergence(
    use: Callable[Concatenate[Localizer, float, P], None],
) -> Callable[Concatenate[Localizer, float, P], None]:
    """Gives the errors of a filter's arithmetic one name."""

    @wraps(use)
    def told(self: Localizer, time: float, /, *args: P.args, **kwargs: P.kwargs) -> None:
        try:
            use(self, time, *args, **kwargs)
        except (ZeroDivisionError, np.linalg.LinAlgError) as error:
            raise FilterDivergedError(time, self.settings, error) from error

    return told


class Localizer:
    """Estimates the pose of one vehicle on one journey.

    Attributes:
        settings: Of the localizer.
        heading: Heading with its standard deviation at a standing start, rad, if known.
        calibration: Offsets measured at rest; none before, and after a rolling start.
        aligned_at: Time at which the filter began to run, s; NaN before.
        rolling: Whether the journey began rolling.
    """

    def __init__(
        self,
        settings: Settings | None = None,
        heading: tuple[float, float] | None = None,
        left_out: Collection[float] = (),
    ) -> None:
        """Prepares for a journey.

        Args:
            settings: Of the localizer.
            heading: Heading with its standard deviation, rad, if known; for a standing start.
            left_out: Times of fixes that are known as outliers: a start may weigh them, the filter does not use them.

        Raises:
            InvalidInputError: The smoother is asked of another filter than the ES-EKF.
        """
        self.settings = settings or Settings()
        if self.settings.smooth and self.settings.filter != "es-ekf":
            raise InvalidInputError(f"smoother: expected the filter es-ekf, got {self.settings.filter}")
        self.calibration: Calibration = NONE
        self._corrector: Corrector | None = None
        self.aligned_at = math.nan
        self.rolling = self.settings.start == "rolling"
        self._low_pass = LowPass(self.settings.alpha)
        self._time: float | None = None
        self._began = math.inf
        self._held_at = self._levelled_at = -math.inf
        self.heading = heading
        self._left_out = frozenset(left_out)
        self._standing = StandingStart(self.settings, heading, self._low_pass)
        self._rolling = RollingStart(self.settings)
        self._early: list[tuple[float, FloatArray, float] | Fix] = []

    @property
    def filter(self) -> Filter | None:
        """The running filter; None before."""
        return None if self._corrector is None else self._corrector.filter

    @property
    def fixes(self) -> list[JudgedFix]:
        """Every fix since the filter runs, outliers included."""
        return [] if self._corrector is None else self._corrector.judged

    @property
    def rejected(self) -> int:
        """Number of outliers among the fixes."""
        return sum(not fix.used for fix in self.fixes)

    @_tells_divergence
    def imu(self, time: float, sample: FloatArray) -> None:
        """Uses a sample that holds for the time since the last one.

        Args:
            time: s; a sample that is not later than the last one is ignored.
            sample: (6,) specific force [m/s^2] and angular rate [rad/s], body frame (x forward, y left, z up).

        Raises:
            InvalidInputError: The vehicle did not stand still during the calibration.
            FilterDivergedError: The filter has diverged.
        """
        if self._time is None:
            self._began = self._time = time
        elif time <= self._time:
            return
        dt, self._time = time - self._time, time
        if self._corrector is not None:
            self._predict(time, self._low_pass.step(self.calibration.apply(sample)), dt)
        elif self.rolling:
            self._rolling.imu(time, self._low_pass.step(sample), dt)
        else:
            self._remember((time, sample, dt))
            try:
                start = self._standing.imu(time, sample, dt)
            except NotStandingError as error:
                self._roll(error)
                return
            self._run_from_rest(start)

    @_tells_divergence
    def gnss(self, time: float, position: FloatArray, sigma_m: float | None = None) -> None:
        """Uses a fix.

        Args:
            time: s.
            position: (3,) east, north, up [m].
            sigma_m: Standard deviation in east and north by the receiver; None: that of the settings.

        Raises:
            FilterDivergedError: The filter has diverged.
        """
        if not np.isfinite(position).all() or time < self._began - MAX_STEP_S:
            return
        sigma_m = sigma_m or self.settings.gnss_sigma_m
        if self._corrector is not None:
            self._correct(time, position, sigma_m)
        elif self.rolling:
            start = self._rolling.gnss(time, position, sigma_m)
            if start is not None:
                self._run_from_first_fix(start)
        else:
            self._remember(Fix(time, position, sigma_m))
            try:
                start = self._standing.gnss(time, position, sigma_m)
            except NotStandingError as error:
                self._roll(error)
                return
            self._run_from_rest(start)

    @_tells_divergence
    def wheel_speed(self, time: float, speed_mps: float) -> None:
        """Uses the speed of the car by its wheels, m/s, while the filter runs.

        Raises:
            FilterDivergedError: The filter has diverged.
        """
        car = self.settings.car
        if self._corrector is not None and self._uses_measurements and math.isfinite(speed_mps):
            self._corrector.correct(PointVelocity.of([speed_mps], [car.wheel_speed_mps], [0], car.axle_m))

    @property
    def pose(self) -> tuple[float, float, float] | None:
        """East, north [m] and heading [rad]; None before the filter runs."""
        if self.filter is None:
            return None
        east, north, _ = self.filter.position.tolist()
        return east, north, self.filter.heading

    @property
    def least_m(self) -> float:
        """Distance by IMU and GNSS that gives the heading, m."""
        return self._standing.least_m

    @property
    def _uses_measurements(self) -> bool:
        return self.settings.filter != "imu"

    def _remember(self, event: tuple[float, FloatArray, float] | Fix) -> None:
        """Keeps what a rolling start would need."""
        if self.settings.start == "auto":
            self._early.append(event)

    def _roll(self, error: NotStandingError) -> None:
        """Begins as a rolling start with all data so far."""
        if self.settings.start == "standing":
            raise error
        self.rolling = True
        self._low_pass = LowPass(self.settings.alpha)
        self._standing = StandingStart(self.settings, self.heading, self._low_pass)
        now, early, self._early = self._time, self._early, []
        for event in early:
            if isinstance(event, Fix):
                self.gnss(event.time, event.position, event.sigma_m)
                continue
            self._time, sample, dt = event
            if self._corrector is None:
                self._rolling.imu(self._time, self._low_pass.step(sample), dt)
            else:
                self._predict(self._time, self._low_pass.step(sample), dt)
        self._time = now

    def _run_from_rest(self, start: InitialState | None) -> None:
        """Starts the filter, and repeats the samples since the vehicle set off, and late fixes."""
        standing = self._standing
        self.calibration = standing.calibration
        if start is None or self._time is None:
            return
        began = self._time - sum(dt for _, dt in standing.moved)
        self._make_filter(start, began)
        times = (began + np.cumsum([dt for _, dt in standing.moved])).tolist()
        samples = [(time, *moved) for time, moved in zip(times, standing.moved, strict=True)]
        self._repeat(began, samples, standing.late)
        standing.moved.clear()
        standing.late.clear()
        self._early.clear()

    def _run_from_first_fix(self, start: InitialState) -> None:
        """Starts the filter at the first fix, and repeats all samples and fixes since."""
        window = self._rolling
        self._make_filter(start, window.fixes[0][0])
        self._rolling = RollingStart(self.settings)
        samples = zip(window.times, window.samples, window.steps, strict=True)
        self._repeat(window.fixes[0][0], samples, window.fixes)

    def _repeat(
        self,
        began: float,
        samples: Iterable[tuple[float, FloatArray, float]],
        fixes: Iterable[tuple[float, FloatArray, float]],
    ) -> None:
        """Passes samples and fixes since a time to the filter, in order of time."""
        now, self._time = self._time, began
        waiting = list(fixes)
        for time, sample, dt in samples:
            while waiting and waiting[0][0] <= time - dt + SAME_TIME_S:
                self._correct(*waiting.pop(0))
            self._time = time
            self._predict(time, sample, dt)
        for fix in waiting:
            self._correct(*fix)
        self._time = now

    def _make_filter(self, start: InitialState, time: float) -> None:
        noise = self.settings.noise
        recorded = self.settings.smooth
        filter_ = RecordedEsEkf(start, noise, time) if recorded else FILTERS[self.settings.filter](start, noise)
        self._corrector = CORRECTORS[self.settings.outliers](filter_)
        self.aligned_at = self._time if self._time is not None else math.nan

    def _predict(self, time: float, sample: FloatArray, dt: float) -> None:
        if self._corrector is None:
            return
        steps = max(1, math.ceil((dt - SAME_TIME_S) / MAX_STEP_S))
        for _ in range(steps):
            self._corrector.predict(sample[:3], sample[3:], dt / steps)
        if dt > GAP_S:
            blind = 0.5 * BLIND_ACCELERATION * dt * dt, BLIND_ACCELERATION * dt, BLIND_YAW_RATE * dt
            self._corrector.loosen(*blind)
        if self._uses_measurements:
            self._constrain(self._corrector, time)

    def _constrain(self, corrector: Corrector, time: float) -> None:
        """Corrects by what cars do, at the intervals of the settings."""
        car = self.settings.car
        if car.sideways_mps and time - self._held_at >= car.every_s:
            self._held_at = time
            corrector.correct(PointVelocity.of([0.0, 0.0], [car.sideways_mps] * 2, [1, 2], car.axle_m))
        if car.level_rad and time - self._levelled_at >= car.level_every_s:
            self._levelled_at = time
            corrector.correct(LevelRoad.of(car.level_rad))

    def _correct(self, time: float, position: FloatArray, sigma_m: float) -> None:
        if self._corrector is None or not self._uses_measurements or time in self._left_out:
            return
        late = self._time - time if self._time is not None else 0.0
        if abs(late) > SAME_TIME_S:
            position = position + late * self._corrector.filter.velocity  # to the time of the last IMU sample
        self._corrector.fix(AntennaPosition.of(position, sigma_m, self.settings.antenna_m), time)
        if not np.isfinite(self._corrector.filter.position).all():
            raise FilterDivergedError(time, self.settings, "its position is no number")
