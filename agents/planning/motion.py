"""Numba kernels shared by planners: inner vehicle model, path, boxes, and IDM. Scalars in, scalars out."""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters

DT = 0.1


class Body(NamedTuple):
    """The ego as planners simulate it: a bicycle with the lags of its actuators, in steps of 0.1 s.

    Attributes:
        length: m.
        width: m.
        wheelbase: m.
        axle: From the rear axle to the centre of the box, m.
        max_steering: rad.
        steering_rate: rad/s.
        keep_steering: Share of a steering error left after 0.1 s.
        keep_drive: Share of an acceleration error left after 0.1 s.
        mean_drive: Mean share of an acceleration error during 0.1 s.
        lateral_limit: Highest lateral acceleration that steering demands, m/s^2.
    """

    length: float
    width: float
    wheelbase: float
    axle: float
    max_steering: float
    steering_rate: float
    keep_steering: float
    keep_drive: float
    mean_drive: float
    lateral_limit: float


def body(vehicle: VehicleParameters, lateral_limit: float) -> Body:
    """The inner model of a vehicle."""
    keep = math.exp(-DT / vehicle.drive_lag)
    return Body(
        length=vehicle.length,
        width=vehicle.width,
        wheelbase=vehicle.wheelbase,
        axle=vehicle.axle_to_centre,
        max_steering=vehicle.max_steering,
        steering_rate=vehicle.max_steering_rate,
        keep_steering=math.exp(-DT / vehicle.steering_lag),
        keep_drive=keep,
        mean_drive=(1.0 - keep) * vehicle.drive_lag / DT,
        lateral_limit=lateral_limit,
    )


@njit(cache=True, error_model="numpy")
def limited_steering(car: Body, speed: float, steering: float) -> float:
    """Demanded front wheel angle, bounded by full lock and the lateral limit, rad."""
    most = min(car.max_steering, math.atan(car.wheelbase * car.lateral_limit / max(speed * speed, 0.01)))
    return min(max(steering, -most), most)


@njit(cache=True, error_model="numpy")
def vehicle_step(
    car: Body,
    x: float,
    y: float,
    heading: float,
    speed: float,
    acceleration: float,
    steering: float,
    demand: float,
    wheel: float,
) -> tuple[float, float, float, float, float, float]:
    """One step of 0.1 s of the bicycle with first-order actuators.

    Args:
        car: The vehicle.
        x: Rear axle, m.
        y: Rear axle, m.
        heading: rad.
        speed: m/s.
        acceleration: m/s^2.
        steering: Front wheel angle, rad.
        demand: Acceleration asked for, m/s^2.
        wheel: Front wheel angle asked for, rad.

    Returns:
        The same six after the step.
    """
    mean = demand + (acceleration - demand) * car.mean_drive
    after = demand + (acceleration - demand) * car.keep_drive
    faster = max(speed + mean * DT, 0.0)
    if faster == 0.0 and demand <= 0.0:
        after = 0.0
    most = car.steering_rate * DT
    turned = min(max((wheel - steering) * (1.0 - car.keep_steering), -most), most)
    turn = 0.5 * (speed + faster) * DT * math.tan(steering + 0.6 * turned) / car.wheelbase
    middle = heading + 0.5 * turn
    moved = 0.5 * (speed + faster) * DT
    return (
        x + moved * math.cos(middle),
        y + moved * math.sin(middle),
        heading + turn,
        faster,
        after,
        steering + turned,
    )


@njit(cache=True, error_model="numpy")
def project(path: FloatArray, first_s: float, spacing: float, x: float, y: float, near: float, reach: float):  # type: ignore[no-untyped-def]
    """Projects a point on the stretch of a path around an arc length.

    Args:
        path: (R, 4) x, y [m], cosine and sine of the heading; equally spaced.
        first_s: Arc length of the first point, m.
        spacing: m.
        x: m.
        y: m.
        near: Arc length around which to look, m.
        reach: How far to either side, m.

    Returns:
        Arc length [m], signed distance [m, left positive], row of the segment.
    """
    last = path.shape[0] - 2
    low = min(max(int((near - reach - first_s) / spacing), 0), last)
    high = min(max(int((near + reach - first_s) / spacing) + 1, low), last)
    best, row, share = math.inf, low, 0.0
    for i in range(low, high + 1):
        ux, uy = path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1]
        dx, dy = x - path[i, 0], y - path[i, 1]
        square = ux * ux + uy * uy
        t = (dx * ux + dy * uy) / square if square > 0.0 else 0.0
        # Straight on before the first point and past the last.
        if i > 0:
            t = max(t, 0.0)
        if i < last:
            t = min(t, 1.0)
        ex, ey = dx - t * ux, dy - t * uy
        distance = ex * ex + ey * ey
        if distance < best:
            best, row, share = distance, i, t
    dx, dy = x - path[row, 0], y - path[row, 1]
    ux, uy = path[row + 1, 0] - path[row, 0], path[row + 1, 1] - path[row, 1]
    side = math.copysign(math.sqrt(best), ux * dy - uy * dx)
    return first_s + (row + share) * spacing, side, row


@njit(cache=True, error_model="numpy")
def pursuit(
    car: Body,
    path: FloatArray,
    first_s: float,
    spacing: float,
    x: float,
    y: float,
    heading: float,
    speed: float,
    s: float,
    offset: float,
) -> float:
    """Front wheel angle [rad] of pure pursuit towards a line beside the path.

    Args:
        car: The vehicle.
        path: See `project`.
        first_s: See `project`.
        spacing: See `project`.
        x: Rear axle, m.
        y: Rear axle, m.
        heading: rad.
        speed: m/s.
        s: Arc length of the box centre, m.
        offset: Of the line, to the left of the path, m.
    """
    ahead = min(max(0.6 * speed, 3.0), 15.0)
    at = (s + ahead - first_s) / spacing
    row = min(max(int(at), 0), path.shape[0] - 2)
    share = at - row
    px = path[row, 0] + share * (path[row + 1, 0] - path[row, 0]) - offset * path[row, 3]
    py = path[row, 1] + share * (path[row + 1, 1] - path[row, 1]) + offset * path[row, 2]
    dx, dy = px - x, py - y
    cos, sin = math.cos(heading), math.sin(heading)
    along, across = dx * cos + dy * sin, dy * cos - dx * sin
    return math.atan2(2.0 * car.wheelbase * across, max(along * along + across * across, 1e-3))


@njit(cache=True, error_model="numpy")
def boxes_meet(
    x: float,
    y: float,
    cos: float,
    sin: float,
    half_length: float,
    half_width: float,
    other_x: float,
    other_y: float,
    other_cos: float,
    other_sin: float,
    other_half_length: float,
    other_half_width: float,
) -> bool:
    """Separating-axis test of two oriented boxes given by centre, direction and half sizes, m."""
    dx, dy = other_x - x, other_y - y
    cos_d, sin_d = abs(cos * other_cos + sin * other_sin), abs(cos * other_sin - sin * other_cos)
    if abs(dx * cos + dy * sin) > half_length + other_half_length * cos_d + other_half_width * sin_d:
        return False
    if abs(dy * cos - dx * sin) > half_width + other_half_length * sin_d + other_half_width * cos_d:
        return False
    if abs(dx * other_cos + dy * other_sin) > other_half_length + half_length * cos_d + half_width * sin_d:
        return False
    return abs(dy * other_cos - dx * other_sin) <= other_half_width + half_length * sin_d + half_width * cos_d


class Idm(NamedTuple):
    """The Intelligent Driver Model's parameters.

    Attributes:
        gap: Distance to a standing leader, m.
        headway: Time gap, s.
        acceleration: m/s^2.
        braking: Comfortable, m/s^2.
        exponent: Of the free road.
        least_gap: Lower bound of a gap, m.
        hardest: Upper bound of the deceleration, m/s^2.

    Source: Treiber, Hennecke, Helbing 2000.
    """

    gap: float
    headway: float
    acceleration: float
    braking: float
    exponent: float
    least_gap: float
    hardest: float


@njit(cache=True, error_model="numpy")
def idm_acceleration(model: Idm, speed: float, target: float, gap: float, leader_speed: float) -> float:
    """IDM's acceleration towards a target speed behind a leader, m/s^2; an infinite gap is a free road."""
    wanted = model.gap + max(
        0.0,
        speed * model.headway + speed * (speed - leader_speed) / (2.0 * math.sqrt(model.acceleration * model.braking)),
    )
    free = (speed / max(target, 0.1)) ** model.exponent
    near = 0.0 if gap == math.inf else (wanted / max(gap, model.least_gap)) ** 2
    wish: float = model.acceleration * (1.0 - free - near)
    return min(max(wish, -model.hardest), model.acceleration)
