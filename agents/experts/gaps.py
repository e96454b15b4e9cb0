"""Gaps: whether oncoming traffic leaves enough time to pass a blocker through the oncoming lane."""

from __future__ import annotations

import math
from dataclasses import dataclass

from numba import njit

PASSING_ACCELERATION = 3.5
ATTAINED = 0.92
LAG_S = 0.3
STEP_S = 0.1
LONGEST_S = 15.0
BEHIND_M = 1.0
REACTION_S = 1.2
DISTANCE_M = 6.5
"""That others keep: the traffic takes an ego that faces it to begin its own length before its front."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """Stretch in which the ego is in the way of oncoming traffic, m from its present centre.

    Attributes:
        enter: Begin of the stretch.
        leave: End of the stretch.
        top: Highest speed of the ego there, m/s.
    """

    enter: float
    leave: float
    top: float


@njit(cache=True)
def leaves_room(
    front: float,
    rear: float,
    pace: float,
    enter: float,
    leave: float,
    top: float,
    speed: float,
    half_length: float,
    braking: float,
    margin: float,
    blocker_speed: float,
) -> bool:
    """Whether an oncoming vehicle has passed before the ego is in its way, or does not meet it there.

    It keeps its speed until the ego is in its lane, and from then on drives so that it could still stop before it after
    `REACTION_S`, as drivers do (Krauss 1998), if it is expected to brake at all.

    Args:
        front: Of the other, m along the route from the ego's centre.
        rear: Of the other, m; beyond its front.
        pace: Speed of the other, m/s.
        enter: Where the ego begins to be in its way, m.
        leave: Where it no longer is, m; moves with the blocker.
        top: The ego's highest speed, m/s.
        speed: The ego's present speed, m/s.
        half_length: Of the ego, m.
        braking: Deceleration expected of the other, m/s^2; 0 for none.
        margin: Additional distance between the two, m.
        blocker_speed: m/s.
    """
    s, in_his_way = 0.0, enter <= 0.0
    if in_his_way and rear < half_length - BEHIND_M:
        return True
    t = 0.0
    while t < LONGEST_S:
        t += STEP_S
        if t > LAG_S:
            speed = min(speed + ATTAINED * PASSING_ACCELERATION * STEP_S, max(top, speed))
        s += speed * STEP_S
        leave += blocker_speed * STEP_S
        gap = front - s - half_length
        if in_his_way and braking > 0.0:
            reaction = braking * REACTION_S
            safe = math.sqrt(reaction**2 + 2.0 * braking * max(gap - DISTANCE_M, 0.0)) - reaction
            pace = max(min(pace, safe), pace - braking * STEP_S, 0.0)
        front, rear = front - pace * STEP_S, rear - pace * STEP_S
        if not in_his_way and s >= enter:
            if rear < s + half_length - BEHIND_M - margin:
                return True
            in_his_way = True
        if in_his_way and front - s - half_length < margin:
            return False
        if s >= leave:
            return True
    return False


def warm_up() -> None:
    """Compiles the kernel, so that no decision waits for it."""
    leaves_room(20.0, 25.0, 10.0, 5.0, 20.0, 10.0, 0.0, 2.0, 0.0, 1.0, 0.0)
