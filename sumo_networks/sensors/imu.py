"""IMU: specific force and angular rate at 100 Hz, with the offsets and the noise of a low-cost IMU."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from gymnasium.spaces import Box

from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.conditions import Conditions
from dohyo.sumo_networks.ego.dynamics import GRAVITY, VehicleParameters
from dohyo.sumo_networks.sensors.base import Sensor, Track
from dohyo.sumo_networks.units import SUBSTEP_S
from dohyo.sumo_networks.world import World

SAMPLES = 10
_Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class ImuNoise:
    """Errors of an IMU. White noise and random walk are the same on each axis, in continuous time.

    Attributes:
        accelerometer_offset: Mean offset, constant per mounting, m/s^2.
        gyroscope_offset: Mean offset, constant per mounting, rad/s.
        accelerometer_spread: Standard deviation of the offset from journey to journey, m/s^2.
        gyroscope_spread: Standard deviation of the offset from journey to journey, rad/s.
        accelerometer_density: Density of white noise, m/s^2 per root Hz.
        gyroscope_density: Density of white noise, rad/s per root Hz.
        accelerometer_walk: Random walk of the offset, m/s^2 per root second.
        gyroscope_walk: Random walk of the offset, rad/s per root second.
        vibration: Standard deviation of a sample's white noise in acceleration while the vehicle moves, m/s^2.
    """

    accelerometer_offset: _Vector = (0.0, 0.0, 0.0)
    gyroscope_offset: _Vector = (0.0, 0.0, 0.0)
    accelerometer_spread: float = 0.0
    gyroscope_spread: float = 0.0
    accelerometer_density: float = 0.0
    gyroscope_density: float = 0.0
    accelerometer_walk: float = 0.0
    gyroscope_walk: float = 0.0
    vibration: float = 0.0


ICM_20600 = ImuNoise(
    # Measured on the kart of Albilani's thesis, table 4.2 (there in m/s^2 and degrees per second).
    accelerometer_offset=(0.266818, 0.180452, -0.089558),
    gyroscope_offset=(math.radians(-1.237829), math.radians(-2.018467), math.radians(-0.798545)),
    # The thesis reports similar offsets on other journeys, without numbers; these numbers are ours.
    accelerometer_spread=0.05,
    gyroscope_spread=math.radians(0.1),
    # TDK's data sheet: 100 ug and 4 mdps per root Hz.
    accelerometer_density=100e-6 * GRAVITY,
    gyroscope_density=math.radians(0.004),
    # No data sheet has these; ours: an offset moves by 0.2 mg and 40 degrees/h in 100 s, as usual for consumer MEMS.
    accelerometer_walk=2e-4,
    gyroscope_walk=2e-5,
)


class ImuErrors:
    """Adds the errors of one IMU to true values, for one journey; the offsets drift from call to call.

    Attributes:
        offset: (6,) offsets of the accelerometer [m/s^2] and the gyroscope [rad/s], at the last sample.
    """

    def __init__(self, noise: ImuNoise, rng: np.random.Generator) -> None:
        self._noise, self._rng = noise, rng
        spread = np.repeat([noise.accelerometer_spread, noise.gyroscope_spread], 3)
        table = np.array([*noise.accelerometer_offset, *noise.gyroscope_offset])
        self.offset: FloatArray = table + spread * rng.standard_normal(6)

    def corrupt(self, true: FloatArray, moving: bool | FloatArray = True, dt: float = SUBSTEP_S) -> FloatArray:
        """Computes the output of the IMU.

        Args:
            true: (N, 6) specific force [m/s^2] and angular rate [rad/s], body frame, in order of time.
            moving: Whether the vehicle moves, for all or (N,) for each sample.
            dt: Time between samples, s.
        """
        noise, n = self._noise, len(true)
        walk = np.repeat([noise.accelerometer_walk, noise.gyroscope_walk], 3) * math.sqrt(dt)
        white = np.repeat([noise.accelerometer_density, noise.gyroscope_density], 3) / math.sqrt(dt)
        drawn = self._rng.standard_normal((2, n, 6))
        offsets = self.offset + np.cumsum(walk * drawn[0], axis=0)
        self.offset = offsets[-1]
        out = true + offsets + white * drawn[1]
        if noise.vibration:
            shaken = noise.vibration * self._rng.standard_normal((n, 3))
            out[:, :3] += shaken * np.reshape(moving, (-1, 1))
        return np.asarray(out)


def specific_force_and_rate(
    speed: FloatArray,
    acceleration: FloatArray,
    yaw_rate: FloatArray,
    yaw_acceleration: FloatArray,
    mounting: tuple[float, float],
) -> FloatArray:
    """Computes the output of a perfect IMU on a flat road.

    The rear axle accelerates by v' ahead and by v w to the left; at other points the rotation adds acceleration.

    Args:
        speed: (N,) speed of the rear axle, m/s.
        acceleration: (N,) acceleration along the heading, m/s^2.
        yaw_rate: (N,) yaw rate, rad/s.
        yaw_acceleration: (N,) yaw acceleration, rad/s^2.
        mounting: Position forward and to the left of the rear axle, m.

    Returns:
        (N, 6) specific force (x forward, y left, z up; at rest 0, 0, g) [m/s^2] and angular rate [rad/s].
    """
    forward, left = mounting
    out = np.zeros((len(speed), 6))
    out[:, 0] = acceleration - yaw_acceleration * left - yaw_rate**2 * forward
    out[:, 1] = speed * yaw_rate + yaw_acceleration * forward - yaw_rate**2 * left
    out[:, 2] = GRAVITY
    out[:, 5] = yaw_rate
    return out


class Imu(Sensor):
    """(10, 6) specific force [m/s^2] and angular rate [rad/s] in the ten steps of 0.01 s since the last tick.

    Columns: forward, left, up; then roll, pitch and yaw rate about the same axes. Row i holds for the 0.01 s that end
    0.1 - 0.01 (i + 1) s ago. At rest it reads 0, 0, 9.81 plus offsets and noise (`ICM_20600`). Before the first tick
    the vehicle stands. The IMU is at the box's centre by default.
    """

    name = "imu"
    track = Track.SENSORS
    space = Box(-np.inf, np.inf, (SAMPLES, 6), np.float32)

    def __init__(
        self,
        rng: np.random.Generator,
        noise: ImuNoise = ICM_20600,
        mounting: tuple[float, float] | None = None,
    ) -> None:
        """Makes an IMU for one ego and episode.

        Args:
            rng: Generator of the noise.
            noise: Errors of the IMU.
            mounting: Position forward and to the left of the rear axle, m; None: the centre of the box.
        """
        self._errors = ImuErrors(noise, rng)
        self._mounting = mounting or (VehicleParameters().axle_to_centre, 0.0)
        self._last_yaw_rate = 0.0

    @classmethod
    def make(cls, conditions: Conditions, rng: np.random.Generator) -> Self:
        """Makes the sensor; see `Sensor`."""
        return cls(rng)

    def read(self, world: World, ego: int) -> Float32Array:
        """Reads the array; see the class."""
        motion = world.egos.motion[ego]
        acceleration, yaw_rate = motion[:, 0], motion[:, 1]
        speed = world.egos.speed[ego] - SUBSTEP_S * (acceleration.sum() - np.cumsum(acceleration))
        yaw_acceleration = np.diff(yaw_rate, prepend=self._last_yaw_rate) / SUBSTEP_S
        self._last_yaw_rate = float(yaw_rate[-1])
        true = specific_force_and_rate(speed, acceleration, yaw_rate, yaw_acceleration, self._mounting)
        return self._errors.corrupt(true, moving=speed > 0.0).astype(np.float32)
