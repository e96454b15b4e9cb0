"""Settings of a localizer, as a configuration that a TOML file and options of the command can fill."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from dohyo.agents.localization.filters.base import FilterNoise, Positive
from dohyo.agents.localization.filters.lowpass import ALPHA
from dohyo.agents.localization.filters.measurements import AT_IMU, Lever
from dohyo.sumo_networks.config import Config

ROAD_NOISE = FilterNoise(accelerometer=0.05, gyroscope=1e-3, accelerometer_walk=2e-4, gyroscope_walk=2e-5)
"""A cheap IMU in a car: the white noise stands for vibration, scale factors and misalignment, which exceed the data
sheet's noise by far. Ours."""
FilterName = Literal["es-ekf", "ekf", "ukf", "imu"]
Start = Literal["auto", "standing", "rolling"]
OutlierPolicy = Literal["none", "gate", "robust"]


class RollingSpread(Config):
    """Standard deviations at a rolling start, before any fix is used.

    Attributes:
        velocity: Of the forward speed, m/s.
        sideways: Of the velocity to the left and upwards, m/s.
        tilt: Of roll and pitch, rad.
        accelerometer_bias: m/s^2; the IMU was not calibrated.
        gyroscope_bias: rad/s.
    """

    velocity: Positive = 3.0
    sideways: Positive = 0.5
    tilt: Positive = math.radians(3.0)
    accelerometer_bias: Positive = 0.3
    gyroscope_bias: Positive = 0.03


class StandingSpread(Config):
    """Standard deviations after a calibration at rest; those of the measured offsets where these are larger.

    Attributes:
        velocity: m/s.
        tilt: Of roll and pitch, rad.
        accelerometer_bias: m/s^2.
        gyroscope_bias: rad/s.
        gravity: m/s^2.
    """

    velocity: Positive = 0.05
    tilt: Positive = math.radians(0.05)
    accelerometer_bias: Positive = 1e-3
    gyroscope_bias: Positive = 1e-4
    gravity: Positive = 1e-3


class CarConstraint(Config):
    """What cars do: they neither slide nor jump, drive on nearly level roads, and their wheels tell their speed.

    Attributes:
        sideways_mps: Standard deviation of the velocity to the left and upwards at the rear axle; None: not used.
        wheel_speed_mps: Standard deviation of a wheel's speed.
        axle_m: Rear axle seen from the IMU: forward, left, up.
        every_s: Time between two uses of `sideways_mps`.
        level_rad: Standard deviation of roll and pitch on roads; None: not used.
        level_every_s: Time between two uses of `level_rad`: slopes persist, so that more would count one road twice.
    """

    sideways_mps: Positive | None = None
    wheel_speed_mps: Positive = 0.2
    axle_m: Lever = AT_IMU
    every_s: Positive = 0.2
    level_rad: Positive | None = 0.05
    level_every_s: Positive = 5.0


class Settings(Config):
    """Settings of a localizer.

    Attributes:
        filter: A name of `localizer.FILTERS`.
        start: "standing": at rest and level at first; "rolling": velocity and heading from the fixes; "auto": standing
            if IMU and fixes agree on it.
        calibrate: Whether to measure the IMU's offsets at rest; otherwise none are subtracted.
        alpha: Coefficient of the low-pass filter; 0: none.
        standing_s: Standing time at the start.
        gnss_sigma_m: Assumed error of a fix that does not state its own.
        align_m: Distance that gives the heading; at least 4 sigma, and up to 14 sigma after a late first fix.
        outliers: Treatment of fixes that surprise the filter; see `outliers`.
        antenna_m: Antenna seen from the IMU, m: forward, left, up.
        smooth: Whether to keep what the smoother needs (ES-EKF only).
        noise: Assumed noise of the IMU.
        standing: Initial spread of a standing start.
        rolling: Initial spread of a rolling start.
        car: Corrections by what cars do; `level_rad` alone is on by default.
    """

    filter: FilterName = "es-ekf"
    start: Start = "auto"
    calibrate: bool = True
    alpha: Annotated[float, Field(ge=0.0, lt=1.0)] = ALPHA
    standing_s: Annotated[float, Field(ge=0.3)] = 3.0
    gnss_sigma_m: Positive = 2.1
    align_m: Positive = 5.0
    outliers: OutlierPolicy = "robust"
    antenna_m: Lever = AT_IMU
    smooth: bool = False
    noise: FilterNoise = ROAD_NOISE
    standing: StandingSpread = StandingSpread()
    rolling: RollingSpread = RollingSpread()
    car: CarConstraint = CarConstraint()
