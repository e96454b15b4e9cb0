"""Impact: full braking at the last moment that still prevents a collision, independent of the other rules."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dohyo.agents.planning.motion import boxes_meet
from dohyo.agents.planning.surroundings import ran_into_from_behind
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.geometry import wrap
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import ActorKind

STEPS = 20
SAFE_ACCELERATION = math.inf
HARD_BRAKING = 7.0
LATE_STEPS = 3
STANDING_M_S = 0.3
SIGHT_M = 35.0
MARGIN_M = 0.1
FASTEST_TURN = 1.0
NEVER = -1.0


class Impact:
    """Predicts two seconds: the ego on its path, the others at constant speed and turn rate."""

    def __init__(self, half_length: float, half_width: float) -> None:
        self._half = half_length + MARGIN_M, half_width + MARGIN_M
        self._half_length = half_length
        self._seen: dict[int, tuple[float, float]] = {}

    def acceleration(
        self, objects: Float32Array, route: Float32Array, speed: float, wish: float, turned: float = 0.0
    ) -> float:
        """Full braking where a later moment would be too late, or to stand while another crosses, else infinite.

        Args:
            objects: (48, 8), see `sensors.objects`.
            route: (80, 7), see `sensors.route`; as the ego will follow it.
            speed: Of the ego, m/s.
            wish: Acceleration that the other rules ask for, m/s^2.
            turned: By the ego since the last tick, rad.
        """
        boxes = self._moving(objects, turned)
        path = route[:, :3].astype(np.float64)
        if speed < STANDING_M_S:
            return self._start(boxes[boxes[:, 3] > STANDING_M_S], path, speed, wish)
        on = impact_speed(boxes, path, speed, wish, STEPS, *self._half)
        if on == NEVER or impact_speed(boxes, path, speed, wish, LATE_STEPS, *self._half) == NEVER:
            return SAFE_ACCELERATION
        return -8.0 if impact_speed(boxes, path, speed, -HARD_BRAKING, 0, *self._half) < on else SAFE_ACCELERATION

    def _start(self, moving: FloatArray, path: FloatArray, speed: float, wish: float) -> float:
        """A standing ego remains so while it would drive into the way of one that moves."""
        if wish <= 0.0 or impact_speed(moving, path, speed, wish, STEPS, *self._half) == NEVER:
            return SAFE_ACCELERATION
        return -8.0

    def _moving(self, objects: Float32Array, turned: float) -> FloatArray:
        """(N, 7) x, y, heading, speed, turn rate [rad/s], length, width of actors near and not behind."""
        rows, seen = [], {}
        for kind, x, y, heading, pace, length, width, key in objects.tolist():
            if kind < 0 or math.hypot(x, y) > SIGHT_M:
                break
            rate = 0.0
            if int(key) in self._seen and pace > 1.0 and kind != ActorKind.PEDESTRIAN:
                before, rate_before = self._seen[int(key)]
                rate = 0.5 * (rate_before + (wrap(heading - before) + turned) / TICK_S)
                rate = min(max(rate, -FASTEST_TURN), FASTEST_TURN)
            seen[int(key)] = heading, rate
            behind = x + 0.5 * length <= -self._half_length
            if not behind and not ran_into_from_behind(x, y, heading, length, self._half_length):
                rows.append((x, y, heading, pace, rate, length, width))
        self._seen = seen
        return np.array(rows, dtype=np.float64).reshape(-1, 7)


def warm_up() -> None:
    """Compiles the kernels, so that no decision waits for them."""
    ran_into_from_behind(0.0, 0.0, 0.0, 5.0, 2.5)
    impact_speed(np.zeros((0, 7)), np.zeros((2, 3)), 1.0, 0.0, 0, 1.0, 1.0)


@njit(cache=True)
def impact_speed(
    boxes: FloatArray,
    path: FloatArray,
    speed: float,
    acceleration: float,
    steps: int,
    half_length: float,
    half_width: float,
) -> float:
    """Speed of the ego at its first contact, m/s; -1 without a contact while it moves.

    Args:
        boxes: (N, 7) x, y [m], heading [rad], speed [m/s], rate of turn [rad/s], length, width [m], ego frame.
        path: (P, 3) x, y [m] and heading [rad] of points a metre apart, from the ego's centre on.
        speed: Of the ego, m/s.
        acceleration: Of the ego at first, m/s^2.
        steps: For how many steps of 0.1 s; then it brakes hard.
        half_length: Of the ego with its margin, m.
        half_width: Of the ego with its margin, m.
    """
    moved = boxes.copy()
    s = 0.0
    for step in range(STEPS):
        speed = max(speed + (acceleration if step < steps else -HARD_BRAKING) * TICK_S, 0.0)
        if speed < 0.1 and (step >= steps or acceleration <= 0.0):
            return NEVER
        s += speed * TICK_S
        i = min(int(s), path.shape[0] - 2)
        share = min(s - i, 1.0)
        x = path[i, 0] + share * (path[i + 1, 0] - path[i, 0]) - path[0, 0]
        y = path[i, 1] + share * (path[i + 1, 1] - path[i, 1]) - path[0, 1]
        cos, sin = math.cos(path[i, 2]), math.sin(path[i, 2])
        for n in range(moved.shape[0]):
            moved[n, 2] += moved[n, 4] * TICK_S
            c, d = math.cos(moved[n, 2]), math.sin(moved[n, 2])
            moved[n, 0] += moved[n, 3] * TICK_S * c
            moved[n, 1] += moved[n, 3] * TICK_S * d
            length, width = 0.5 * moved[n, 5], 0.5 * moved[n, 6]
            if boxes_meet(x, y, cos, sin, half_length, half_width, moved[n, 0], moved[n, 1], c, d, length, width):
                return speed
    return NEVER
