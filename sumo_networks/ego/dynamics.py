"""The ego's dynamics: a single-track model with actuator lags and limited tyre friction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.units import SUBSTEP_S

GRAVITY = 9.81
X, Y, HEADING, SPEED, DRIVE, STEERING, ACCELERATION, YAW_RATE = range(8)
STATE_SIZE = 8


@dataclass(frozen=True, slots=True)
class VehicleParameters:
    """Parameters of a vehicle; the defaults are a compact car.

    Attributes:
        length: Length of the box, m.
        width: Width of the box, m.
        wheelbase: Distance between the axles, m.
        rear_overhang: Distance from the rear bumper to the rear axle, m.
        max_steering: Front wheel angle at full lock, rad.
        max_steering_rate: Largest rate of the front wheel angle, rad/s.
        max_traction: Largest acceleration from standstill, m/s^2.
        power_to_mass: Power over mass, which bounds the traction at speed, W/kg.
        max_braking: Deceleration at full brake on dry road, m/s^2.
        drag: Air resistance over mass, 1/m.
        rolling_resistance: Deceleration by rolling resistance, m/s^2.
        drive_lag: Time constant of traction and brakes, s.
        steering_lag: Time constant of the steering, s.
        friction: Tyre-road coefficient.
    """

    length: float = 4.5
    width: float = 1.8
    wheelbase: float = 2.7
    rear_overhang: float = 0.9
    max_steering: float = 0.6
    max_steering_rate: float = 1.2
    max_traction: float = 4.0
    power_to_mass: float = 65.0
    max_braking: float = 8.0
    drag: float = 0.0003
    rolling_resistance: float = 0.12
    drive_lag: float = 0.1
    steering_lag: float = 0.08
    friction: float = 0.9

    @property
    def axle_to_centre(self) -> float:
        """Distance from the rear axle forward to the centre of the box, m."""
        return self.length / 2 - self.rear_overhang

    def traction_limit(self, speed: float) -> float:
        """Largest acceleration of the drive at a speed, m/s^2."""
        return min(self.max_traction, self.power_to_mass / max(speed, 0.1))

    def resistance(self, speed: float) -> float:
        """Deceleration by air and rolling resistance, m/s^2."""
        return self.drag * speed * speed + (self.rolling_resistance if speed > 0 else 0.0)


class CarConstants(NamedTuple):
    """Values of `VehicleParameters` that `advance` needs, in the same units; grip: friction times gravity, m/s^2."""

    wheelbase: float
    max_steering: float
    max_steering_rate: float
    max_traction: float
    power_to_mass: float
    max_braking: float
    drag: float
    rolling_resistance: float
    drive_lag: float
    steering_lag: float
    grip: float


def car_constants(car: VehicleParameters) -> CarConstants:
    """Constants of a car, for `advance`."""
    return CarConstants(
        wheelbase=car.wheelbase,
        max_steering=car.max_steering,
        max_steering_rate=car.max_steering_rate,
        max_traction=car.max_traction,
        power_to_mass=car.power_to_mass,
        max_braking=car.max_braking,
        drag=car.drag,
        rolling_resistance=car.rolling_resistance,
        drive_lag=car.drive_lag,
        steering_lag=car.steering_lag,
        grip=car.friction * GRAVITY,
    )


@njit(cache=True)
def advance(
    states: FloatArray,
    commands: FloatArray,
    ticks: int,
    dt: float,
    car: CarConstants,
    motion: FloatArray | None = None,
) -> None:
    """Integrates the single-track model in place.

    The rear axle follows the bicycle model's path while the tyres grip. Longitudinal and lateral acceleration share the
    friction circle: braking reduces the grip that is left for the curve, and the car may then understeer.

    Args:
        states: (E, 8) rear axle x, y [m], heading [rad], speed [m/s], drive [m/s^2], steering [rad],
            acceleration [m/s^2], yaw rate [rad/s].
        commands: (E, 2) demanded drive (traction minus brakes) [m/s^2] and front wheel angle [rad].
        ticks: Number of substeps.
        dt: Length of a substep, s.
        car: Constants of all vehicles.
        motion: (E, ticks, 2) output: acceleration [m/s^2] and yaw rate [rad/s] of every substep; None: no output.
    """
    for e in range(states.shape[0]):
        x, y, heading, speed, drive, steering = states[e, :6]
        acceleration = yaw_rate = 0.0
        for tick in range(ticks):
            traction = min(car.max_traction, car.power_to_mass / max(speed, 0.1))
            demand = min(max(commands[e, 0], -car.max_braking), traction)
            drive += (demand - drive) * dt / car.drive_lag
            wanted = min(max(commands[e, 1], -car.max_steering), car.max_steering)
            rate = (wanted - steering) / car.steering_lag
            steering += min(max(rate, -car.max_steering_rate), car.max_steering_rate) * dt
            force = min(max(drive, -car.grip), car.grip)
            resistance = car.drag * speed * speed + (car.rolling_resistance if speed > 0.0 else 0.0)
            faster = speed + (force - resistance) * dt
            if speed == 0.0 and force <= car.rolling_resistance:
                faster = 0.0
            faster = max(faster, 0.0)
            acceleration = (faster - speed) / dt
            speed = faster
            sideways = math.sqrt(max(car.grip * car.grip - force * force, 0.04 * car.grip * car.grip))
            curvature = math.tan(steering) / car.wheelbase
            yaw_rate = speed * curvature
            if abs(yaw_rate * speed) > sideways:
                yaw_rate = math.copysign(sideways / speed, curvature)
            middle = heading + 0.5 * yaw_rate * dt
            x += speed * math.cos(middle) * dt
            y += speed * math.sin(middle) * dt
            heading += yaw_rate * dt
            if motion is not None:
                motion[e, tick, 0], motion[e, tick, 1] = acceleration, yaw_rate
        states[e, 0], states[e, 1], states[e, 3], states[e, 4], states[e, 5] = x, y, speed, drive, steering
        states[e, 2] = (heading + math.pi) % (2.0 * math.pi) - math.pi
        states[e, 6], states[e, 7] = acceleration, yaw_rate


class Vehicles:
    """The egos' vehicles, advanced together.

    Attributes:
        parameters: Parameters of all vehicles.
        states: (E, 8) states of the vehicles, see `advance`.
        motion: (E, S, 2), acceleration [m/s^2] and yaw rate [rad/s] in each substep of the last call of `advance`.
    """

    def __init__(self, parameters: VehicleParameters, count: int) -> None:
        self.parameters = parameters
        self.states: FloatArray = np.zeros((count, STATE_SIZE))
        self.motion: FloatArray = np.zeros((count, 10, 2))
        self._constants = car_constants(parameters)

    def place(self, vehicle: int, x: float, y: float, heading: float, speed: float = 0.0) -> None:
        """Puts a vehicle with the centre of its box at x, y [m], at rest or coasting straight on at a speed [m/s]."""
        back = self.parameters.axle_to_centre
        self.states[vehicle] = 0.0
        self.states[vehicle, :3] = x - back * math.cos(heading), y - back * math.sin(heading), heading
        self.states[vehicle, SPEED] = speed

    def advance(self, commands: FloatArray, seconds: float) -> None:
        """Drives all vehicles for a time.

        Args:
            commands: (E, 2) demanded drive [m/s^2] and front wheel angle [rad].
            seconds: Length of the drive, a multiple of the substep of 0.01 s.
        """
        substeps = round(seconds / SUBSTEP_S)
        self.motion = np.empty((len(self.states), substeps, 2))
        advance(self.states, commands, substeps, SUBSTEP_S, self._constants, self.motion)

    def put(self, vehicle: int, centre: FloatArray, heading: float, speed: float, rates: tuple[float, float]) -> None:
        """Puts a vehicle that is simulated elsewhere at its place after a tick.

        Args:
            vehicle: Number of the vehicle.
            centre: (2,), m: centre of the box.
            heading: rad.
            speed: Speed along the heading, m/s.
            rates: Acceleration [m/s^2] and yaw rate [rad/s] during the tick.
        """
        self.place(vehicle, centre.item(0), centre.item(1), heading, speed)
        self.states[vehicle, ACCELERATION:] = rates
        if speed > 0.0:
            bend = math.atan(rates[1] * self.parameters.wheelbase / speed)
            self.states[vehicle, STEERING] = min(max(bend, -self.parameters.max_steering), self.parameters.max_steering)
        self.motion[vehicle] = rates

    def centres(self) -> FloatArray:
        """(E, 2), m: centres of the boxes."""
        return _centres(self.states, self.parameters.axle_to_centre)


@njit(cache=True)
def _centres(states: FloatArray, axle_to_centre: float) -> FloatArray:
    """(E, 2), m: box centres of vehicles in states (E, 8), each `axle_to_centre` [m] ahead of its rear axle."""
    out = np.empty((states.shape[0], 2))
    for e in range(states.shape[0]):
        out[e, 0] = states[e, 0] + axle_to_centre * math.cos(states[e, 2])
        out[e, 1] = states[e, 1] + axle_to_centre * math.sin(states[e, 2])
    return out
