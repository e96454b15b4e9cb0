"""Synthetic journeys: a smooth truth at 100 Hz along a real route, with simulated IMU and GNSS.

The vehicle is the ego's single-track model, steered by pure pursuit along the route's path; the headings of
SUMO's own vehicles jump from one piece of a lane to the next, and cannot be differentiated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.control import SpeedPid, pure_pursuit, pursuit_distance
from dohyo.sumo_networks.ego.dynamics import HEADING, SPEED, VehicleParameters, Vehicles
from dohyo.sumo_networks.errors import UnknownNameError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place
from dohyo.sumo_networks.sensors.gnss import GnssErrors, GnssNoise
from dohyo.sumo_networks.sensors.imu import ImuErrors, ImuNoise, specific_force_and_rate

DT = 0.01
TICK = 10
LATERAL, BRAKING = 2.0, 2.0  # m/s^2, of a calm driver


@dataclass(frozen=True)
class Journey:
    """True motion at 100 Hz.

    Attributes:
        name: Of the route.
        time: (N,), s.
        position: (N, 2), m, network frame: centre of the box, where the IMU sits.
        velocity: (N, 2), m/s, of that point.
        heading: (N,), rad, not wrapped.
        imu: (N, 6) specific force [m/s^2] and angular rate [rad/s] over the step that ends at this time.
        moving: (N,) whether the vehicle moves.
    """

    name: str
    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    heading: FloatArray
    imu: FloatArray
    moving: FloatArray


def drive_route(
    name: str, route: Route, standing_s: float = 5.0, stops_m: tuple[float, ...] = (), seconds: float = 1e9
) -> Journey:
    """Drives a route gently from standstill to its end.

    Args:
        name: Of the journey.
        route: To follow.
        standing_s: Standing time before the start.
        stops_m: Places along the route of stops of 5 s.
        seconds: Ends the journey earlier.
    """
    car = VehicleParameters()
    vehicles, pid = Vehicles(car, 1), SpeedPid(car, DT * TICK)
    x, y = route.position[0].tolist()
    vehicles.place(0, x, y, route.heading.item(0))
    allowed = _speeds(route)
    states: list[FloatArray] = []
    progress, standing, stops = 0.0, standing_s, list(stops_m)
    while progress < route.length - 1.0 and len(states) * DT < seconds:
        speed, heading = vehicles.states.item(0, SPEED), vehicles.states.item(0, HEADING)
        centre = vehicles.centres()[0]
        progress, _, _ = route.project(float(centre[0]), float(centre[1]), progress)
        target = float(allowed[route.index(progress)])
        if stops:
            target = min(target, math.sqrt(2.0 * BRAKING * max(stops[0] - progress, 0.0)))
            if speed < 0.3 and stops[0] - progress < 1.0:
                standing, stops = 5.0, stops[1:]
        target, standing = (0.0 if standing > 0.0 else target), standing - DT * TICK
        aim = route.position[route.index(progress + pursuit_distance(speed))] - centre
        ahead, left = aim @ [math.cos(heading), math.sin(heading)], aim @ [-math.sin(heading), math.cos(heading)]
        drive = min(pid.drive(target, speed), 2.0)
        command = np.array([[drive, pure_pursuit(car, float(ahead), float(left))]])
        for _ in range(TICK):
            vehicles.advance(command, DT)
            states.append(np.concatenate([vehicles.states[0, :4], vehicles.motion[0, 0]]))
    return _journey(name, np.array(states), car)


def _speeds(route: Route) -> FloatArray:
    """(N,) speed of a calm driver at each point of a route, m/s."""
    curve = np.sqrt(LATERAL / np.maximum(np.abs(route.curvature), 1e-3))
    allowed = np.minimum(route.speed_limit, curve)
    for i in range(len(allowed) - 2, -1, -1):
        allowed[i] = min(allowed[i], math.sqrt(allowed[i + 1] ** 2 + 2.0 * 1.5))
    return np.asarray(allowed)


def _journey(name: str, states: FloatArray, car: VehicleParameters) -> Journey:
    x, y, wrapped, speed, acceleration, yaw_rate = states.T
    lever = car.axle_to_centre
    imu = specific_force_and_rate(
        speed, acceleration, yaw_rate, np.diff(yaw_rate, prepend=0.0) / DT, mounting=(lever, 0.0)
    )
    cos, sin = np.cos(wrapped), np.sin(wrapped)
    return Journey(
        name=name,
        time=DT * np.arange(1.0, len(states) + 1.0),
        position=np.column_stack([x + lever * cos, y + lever * sin]),
        velocity=np.column_stack([speed * cos - yaw_rate * lever * sin, speed * sin + yaw_rate * lever * cos]),
        heading=np.unwrap(wrapped),
        imu=imu,
        moving=(speed > 0.0).astype(np.float64),
    )


@dataclass(frozen=True)
class Recording:
    """Sensor data of a journey.

    Attributes:
        imu: (N, 6), at the journey's times.
        fix_rows: (M,) row of the journey of each fix.
        fixes: (M, 3), m.
    """

    imu: FloatArray
    fix_rows: FloatArray
    fixes: FloatArray


def record(
    journey: Journey, imu: ImuNoise, gnss: GnssNoise, rng: np.random.Generator, open_sky_s: float = 0.0
) -> Recording:
    """Simulates an IMU and a receiver on a journey.

    Args:
        journey: The true motion.
        imu: Errors of the IMU.
        gnss: Errors of the receiver; its rate and dropout hold after the open sky.
        rng: Of all errors.
        open_sky_s: Time from the start with ten fixes a second.
    """
    imu_rng, gnss_rng, drop_rng = rng.spawn(3)
    samples = ImuErrors(imu, imu_rng).corrupt(journey.imu, journey.moving, DT)
    errors, rows, fixes = GnssErrors(gnss, gnss_rng), [], []
    every = round(1.0 / (gnss.rate_hz * DT))
    for row in range(TICK - 1, len(journey.time), TICK):
        # Drawn for unused fixes too, so that all rates see the same errors.
        fix, dropped = errors.corrupt(np.append(journey.position[row], 0.0), DT * TICK), drop_rng.random()
        under_open_sky = journey.time[row] <= open_sky_s
        if under_open_sky or ((row + 1) % every == 0 and dropped >= gnss.dropout):
            rows.append(row)
            fixes.append(fix)
    return Recording(samples, np.array(rows, dtype=np.float64), np.array(fixes).reshape(-1, 3))


ROUTES: Mapping[str, tuple[str, str, tuple[str, ...], tuple[float, ...]]] = MappingProxyType(
    {
        "straight": ("avenue_1_far_west_1", "avenue_5_1", (), ()),
        "roundabout": ("-avenue_0_1", "avenue_0_1", ("west_street", "hill_road_0"), ()),
        "junction": ("hill_road_2_1", "hill_street_3_1", ("lime_street_3", "lime_row_5"), (430.0, 675.0, 1190.0)),
    }
)
"""The study's routes on the network "district": start lane, goal lane, edges between, and stops."""


def errors_of(route: str, seed: int, part: int = 0) -> np.random.Generator:
    """Random stream of the errors on a route: the same for all arms, another one on each route.

    Args:
        route: A name of `ROUTES`.
        seed: Of the journey.
        part: Number of the stream, where a journey needs several.
    """
    return np.random.default_rng([seed, list(ROUTES).index(route), part])


def journey_named(name: str, standing_s: float = 5.0, seconds: float = 1e9) -> Journey:
    """Drives one of `ROUTES`.

    Raises:
        UnknownNameError: There is no such route.
    """
    if name not in ROUTES:
        raise UnknownNameError("route", name, ROUTES)
    start, goal, via, stops = ROUTES[name]
    places = Place(lane=start, position_m=5.0), Place(lane=goal, position_m=-5.0)
    mission = Mission(name=name, start=places[0], goal=places[1], via=via)
    return drive_route(name, plan_route(load_network("district"), mission), standing_s, stops, seconds)
