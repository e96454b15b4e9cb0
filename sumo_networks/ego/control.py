"""Control interfaces: they turn an action into a demand on the vehicle's drive and steering."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

import numpy as np
from gymnasium.spaces import Box
from numba import njit

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.errors import AgentError, UnknownNameError
from dohyo.sumo_networks.world import World

MAX_TARGET_SPEED = 40.0
WAYPOINT_COUNT = 8
WAYPOINT_INTERVAL_S = 0.5


class InvalidActionError(AgentError):
    """The agent's answer is no valid action."""


class Control(ABC):
    """Turns one ego's actions into demands on its vehicle; one instance per ego and episode.

    Attributes:
        space: Shape and bounds of an action. Values outside the bounds are clipped; a wrong shape, a NaN or an infinity
            is an error.
    """

    space: Box

    def __init__(self, vehicle: VehicleParameters, dt: float) -> None:
        self.vehicle = vehicle
        self.dt = dt
        self._low = self.space.low.astype(np.float64).reshape(-1)
        self._high = self.space.high.astype(np.float64).reshape(-1)

    def command(self, action: object, world: World, ego: int) -> tuple[float, float]:
        """Computes the demand of one tick.

        Args:
            action: Action of the agent, see `space`.
            world: World before the tick.
            ego: Index of the ego.

        Returns:
            Drive (traction minus brakes) [m/s^2] and front wheel angle [rad].

        Raises:
            InvalidActionError: The action has a wrong shape or type, or is not finite.
        """
        return self._command(self.checked(action), world, ego)

    @abstractmethod
    def _command(self, action: FloatArray, world: World, ego: int) -> tuple[float, float]: ...

    def repeated(self, action: FloatArray) -> FloatArray:
        """Action of a tick for which no decision came, after the last action."""
        return action

    def checked(self, action: object) -> FloatArray:
        """Returns the action as an array within the space's bounds.

        Raises:
            InvalidActionError: The action has a wrong shape or type, or is not finite.
        """
        try:
            given = np.asarray(action)
            if given.dtype.kind not in "biuf":
                raise TypeError(f"expected numbers, got dtype {given.dtype}")
            array = given.astype(np.float64, order="C")
        except Exception as error:  # the conversion of an unknown object may raise any error
            what = f"an array of shape {self.space.shape}"
            raise InvalidActionError(f"expected {what}, got {type(action).__name__}: {error}"[:200]) from error
        if array.shape != self.space.shape:
            raise InvalidActionError(f"expected an action of shape {self.space.shape}, got shape {array.shape}")
        finite = _clip(array.reshape(-1), self._low, self._high)
        if not finite:
            raise InvalidActionError(f"expected finite numbers, got {given.tolist()}")
        return array


@njit(cache=True)
def _clip(values: FloatArray, low: FloatArray, high: FloatArray) -> bool:
    """Clips values (N,) in place up to the first that is not finite; returns whether all are finite."""
    for i in range(values.shape[0]):
        if not math.isfinite(values[i]):
            return False
        values[i] = min(max(values[i], low[i]), high[i])
    return True


class PedalsSteering(Control):
    """(3,) throttle and brake in [0, 1], steering in [-1, 1] of full lock, left positive."""

    space = Box(np.array([0, 0, -1], np.float32), np.array([1, 1, 1], np.float32))

    def _command(self, action: FloatArray, world: World, ego: int) -> tuple[float, float]:
        throttle, brake, steering = action
        traction = self.vehicle.traction_limit(float(world.egos.speed[ego]))
        drive = throttle * traction - brake * self.vehicle.max_braking
        return float(drive), float(steering) * self.vehicle.max_steering


class AccelerationSteering(Control):
    """(2,) acceleration in [-8, 4] m/s^2, steering in [-1, 1] of full lock, left positive.

    Accelerations up to 0.12 m/s^2, the rolling resistance, do not move a car that stands.
    """

    space = Box(np.array([-8, -1], np.float32), np.array([4, 1], np.float32))

    def _command(self, action: FloatArray, world: World, ego: int) -> tuple[float, float]:
        drive = action[0] + self.vehicle.resistance(float(world.egos.speed[ego]))
        return float(drive), float(action[1]) * self.vehicle.max_steering


class SpeedPid:
    """PI controller from target speed to drive, with the road's resistance fed forward.

    Attributes:
        gain: Proportional gain, 1/s.
        integral_gain: Integral gain, 1/s^2.
        integral_limit: Bound of the integral term, m/s^2.
    """

    def __init__(self, vehicle: VehicleParameters, dt: float) -> None:
        self.vehicle, self.dt = vehicle, dt
        self.gain, self.integral_gain, self.integral_limit = 1.6, 0.2, 0.5
        self._integral = 0.0

    def drive(self, target: float, speed: float) -> float:
        """Demanded drive, m/s^2; at a target of 0 it brakes by 3 m/s^2 below 0.5 m/s, and keeps the car there."""
        if target < 0.05 and speed < 0.5:
            self._integral = 0.0
            return -3.0
        error = target - speed
        share = self.integral_gain * error * self.dt
        self._integral = min(max(self._integral + share, -self.integral_limit), self.integral_limit)
        return self.gain * error + self._integral + self.vehicle.resistance(speed)


class TargetSpeedSteering(Control):
    """(2,) target speed in [0, 40] m/s, steering in [-1, 1] of full lock, left positive; a PI controls the speed."""

    space = Box(np.array([0, -1], np.float32), np.array([MAX_TARGET_SPEED, 1], np.float32))

    def __init__(self, vehicle: VehicleParameters, dt: float) -> None:
        super().__init__(vehicle, dt)
        self._pid = SpeedPid(vehicle, dt)

    def _command(self, action: FloatArray, world: World, ego: int) -> tuple[float, float]:
        drive = self._pid.drive(float(action[0]), float(world.egos.speed[ego]))
        return drive, float(action[1]) * self.vehicle.max_steering


class Waypoints(Control):
    """(8, 2) positions of the box centre in the ego's frame [m], 0.5 s apart; tracked by pure pursuit."""

    space = Box(-200.0, 200.0, (WAYPOINT_COUNT, 2), np.float32)

    def __init__(self, vehicle: VehicleParameters, dt: float) -> None:
        super().__init__(vehicle, dt)
        self._pid = SpeedPid(vehicle, dt)

    def _command(self, action: FloatArray, world: World, ego: int) -> tuple[float, float]:
        speed = float(world.egos.speed[ego])
        steps = np.hypot(*np.diff(np.vstack([[0.0, 0.0], action]), axis=0).T)
        target = float(steps[:2].mean()) / WAYPOINT_INTERVAL_S
        reach = np.cumsum(steps)
        aim = action[min(int(np.searchsorted(reach, pursuit_distance(speed))), WAYPOINT_COUNT - 1)]
        return self._pid.drive(target, speed), pure_pursuit(self.vehicle, float(aim[0]), float(aim[1]))


class LaneCommand(Control):
    """(2,) target speed in [0, 40] m/s, and lane: 0 the route's lane, 1 the lane to its left, -1 to its right."""

    space = Box(np.array([0, -1], np.float32), np.array([MAX_TARGET_SPEED, 1], np.float32))

    def __init__(self, vehicle: VehicleParameters, dt: float) -> None:
        super().__init__(vehicle, dt)
        self._pid = SpeedPid(vehicle, dt)

    def _command(self, action: FloatArray, world: World, ego: int) -> tuple[float, float]:
        route, egos = world.routes[ego], world.egos
        speed = float(egos.speed[ego])
        i = route.index(float(egos.progress[ego]) + pursuit_distance(speed))
        shift, across = round(float(action[1])) * route.width.item(i), route.heading.item(i)
        (aim_x, aim_y), (x, y) = route.position[i].tolist(), egos.position[ego].tolist()
        heading = egos.heading.item(ego)
        dx, dy = aim_x - shift * math.sin(across) - x, aim_y + shift * math.cos(across) - y
        cos, sin = math.cos(heading), math.sin(heading)
        steering = pure_pursuit(self.vehicle, dx * cos + dy * sin, dy * cos - dx * sin)
        return self._pid.drive(float(action[0]), speed), steering


def pursuit_distance(speed: float) -> float:
    """Look-ahead distance of pure pursuit, m."""
    return min(max(0.6 * speed, 2.0), 15.0)


def pure_pursuit(vehicle: VehicleParameters, x: float, y: float) -> float:
    """Front wheel angle [rad] of the circle from the rear axle through a point in the frame of the box centre [m]."""
    x += vehicle.axle_to_centre
    return math.atan2(2.0 * vehicle.wheelbase * y, max(x * x + y * y, 1e-3))


Controls = Mapping[str, Callable[[VehicleParameters, float], Control]]

CONTROLS: Controls = {
    "pedals_steering": PedalsSteering,
    "acceleration_steering": AccelerationSteering,
    "target_speed_steering": TargetSpeedSteering,
    "waypoints": Waypoints,
    "lane_command": LaneCommand,
}


def make_control(name: str, vehicle: VehicleParameters, dt: float, among: Controls = CONTROLS) -> Control:
    """A control interface by name.

    Raises:
        UnknownNameError: No control interface has that name.
    """
    if name not in among:
        raise UnknownNameError("control", name, among)
    return among[name](vehicle, dt)
