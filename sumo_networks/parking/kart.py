"""The kart: a kinematic bicycle with motor, brake and steering that lag, rolling resistance and a limit of grip.

The thesis drives a Sodi RSX 04 and prints no parameter of it. Sizes and mass are those of the electric Sodi RTX
(1.85 x 1.35 m, 180 kg with lithium batteries), the wheelbase is that of Sodi chassis (1.05 m). The other numbers are
ours: a driver of 75 kg, and the torques of a kart whose speed is limited to 20 km/h, as on rental tracks.
"""

from __future__ import annotations

import math
from typing import Final

from numba import njit

from dohyo.sumo_networks.arrays import FloatArray

LENGTH_M: Final = 1.85
WIDTH_M: Final = 1.35
WHEELBASE_M: Final = 1.05
"""The centre of the box is half-way between the axles."""
MASS_KG: Final = 255.0
WHEEL_RADIUS_M: Final = 0.14
MAX_MOTOR_TORQUE_NM: Final = 84.0
"""At the rear axle: 2.4 m/s^2 from standstill; it falls linearly to 0 at the highest speed."""
MAX_BRAKE_TORQUE_NM: Final = 140.0
"""At all wheels together: 3.9 m/s^2."""
MAX_STEERING_RAD: Final = math.radians(30.0)
"""A turning radius of 1.8 m at the rear axle."""
MAX_SPEED_MPS: Final = 20.0 / 3.6
ROLLING_RESISTANCE: Final = 0.015
GRIP: Final = 0.8
"""Friction coefficient: it limits the lateral acceleration, so that a fast kart understeers."""
GRAVITY_MPS2: Final = 9.81

TICK_S: Final = 0.1
"""Time between two decisions."""
SUBSTEPS: Final = 4
SUBSTEP_S: Final = TICK_S / SUBSTEPS
MOTOR_LAG_S: Final = 0.10
BRAKE_LAG_S: Final = 0.05
STEERING_LAG_S: Final = 0.15

RADIUS_M: Final = 0.5 * math.hypot(LENGTH_M, WIDTH_M)
"""Of the circle around the box."""

X, Y, HEADING, COS, SIN, SPEED, STEERING, MOTOR, BRAKE, DRIVEN = range(10)
"""Columns of a kart's state: centre of the box [m], heading [rad] with its cosine and sine, speed [m/s, negative in
reverse], steering angle [rad, left positive], the torques [Nm] that motor and brake have at present, and the distance
driven [m]."""
STATE: Final = 10

_MOTOR_STEP: Final = 1.0 - math.exp(-SUBSTEP_S / MOTOR_LAG_S)
_BRAKE_STEP: Final = 1.0 - math.exp(-SUBSTEP_S / BRAKE_LAG_S)
_STEERING_STEP: Final = 1.0 - math.exp(-SUBSTEP_S / STEERING_LAG_S)


@njit(cache=True)
def drive(karts: FloatArray, number: int, torque: float, steering: float, brake: float) -> None:
    """Advances a kart by one substep.

    Args:
        karts: (K, 10) states, of which one is changed.
        number: Its row.
        torque: Motor torque as a share of its maximum, in [-1, 1]; negative: backwards.
        steering: Steering angle as a share of its maximum, in [-1, 1]; positive: left.
        brake: Brake torque as a share of its maximum; none below 0.
    """
    motor = karts[number, MOTOR] + (torque * MAX_MOTOR_TORQUE_NM - karts[number, MOTOR]) * _MOTOR_STEP
    braked = karts[number, BRAKE] + (max(brake, 0.0) * MAX_BRAKE_TORQUE_NM - karts[number, BRAKE]) * _BRAKE_STEP
    if braked < 1e-9:
        braked = 0.0  # numbers near the smallest that there are make a processor slow
    steered = karts[number, STEERING] + (steering * MAX_STEERING_RAD - karts[number, STEERING]) * _STEERING_STEP
    before = karts[number, SPEED]
    speed = _next_speed(before, motor, braked)
    karts[number, MOTOR], karts[number, BRAKE], karts[number, STEERING] = motor, braked, steered
    karts[number, SPEED] = speed
    distance = 0.5 * (before + speed) * SUBSTEP_S
    if distance == 0.0:
        return
    karts[number, DRIVEN] += abs(distance)
    most = GRIP * GRAVITY_MPS2 / max(speed * speed, 1e-9)
    turned = distance * min(max(_tangent(steered) / WHEELBASE_M, -most), most)
    # The rear axle moves along the chord of its arc; the centre of the box is half a wheelbase before it.
    cos, sin = karts[number, COS], karts[number, SIN]
    middle_cos, middle_sin = _rotated(cos, sin, 0.5 * turned)
    after_cos, after_sin = _rotated(middle_cos, middle_sin, 0.5 * turned)
    karts[number, X] += distance * middle_cos + 0.5 * WHEELBASE_M * (after_cos - cos)
    karts[number, Y] += distance * middle_sin + 0.5 * WHEELBASE_M * (after_sin - sin)
    karts[number, COS], karts[number, SIN] = after_cos, after_sin
    heading = karts[number, HEADING] + turned
    if heading >= math.pi:
        heading -= 2.0 * math.pi
    elif heading < -math.pi:
        heading += 2.0 * math.pi
    karts[number, HEADING] = heading


@njit(cache=True)
def _tangent(angle: float) -> float:
    """Tangent by a continued fraction: within 2e-9 up to 30 degrees, and faster than the exact one."""
    square = angle * angle
    return angle * (945.0 - square * (105.0 - square)) / (945.0 - square * (420.0 - 15.0 * square))


@njit(cache=True)
def _rotated(cos: float, sin: float, angle: float) -> tuple[float, float]:
    """A direction turned by a small angle, by series: within 1e-15 up to 0.05 rad."""
    square = angle * angle
    turn_cos = 1.0 - square * (0.5 - square * (1.0 / 24.0 - square / 720.0))
    turn_sin = angle * (1.0 - square * (1.0 / 6.0 - square * (1.0 / 120.0 - square / 5040.0)))
    return cos * turn_cos - sin * turn_sin, sin * turn_cos + cos * turn_sin


@njit(cache=True)
def _next_speed(speed: float, motor: float, brake: float) -> float:
    """Speed one substep later: brake and rolling resistance can stop the kart and never move it."""
    fading = 1.0 - max(speed if motor > 0.0 else -speed, 0.0) / MAX_SPEED_MPS
    pushed = speed + SUBSTEP_S * motor * max(fading, 0.0) / (WHEEL_RADIUS_M * MASS_KG)
    lost = SUBSTEP_S * (brake / (WHEEL_RADIUS_M * MASS_KG) + ROLLING_RESISTANCE * GRAVITY_MPS2)
    if pushed > 0.0:
        return max(pushed - lost, 0.0)
    return min(pushed + lost, 0.0)
