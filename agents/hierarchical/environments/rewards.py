"""Rewards of the sub-policies: speed, distance and angle to the path, multiplied; an infraction overrides them.

R = f(r_v) f(r_d) f(r_alpha), f(r) = r^2. Source: Albilani 2023, equations 6.1 to 6.4, corrected: r_v = -10 on an
infraction would be +100 once squared, and 0 times r_d = 0. So an infraction is worth -10 in any case, and every share
is kept in [0, 1] before it is squared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from dohyo.agents.hierarchical.environments.pace import Pace

Form = Literal["product", "sum"]
INFRACTION = -10.0
FARTHEST_M = 3.0
WIDEST_RAD = math.radians(90.0)


@dataclass(frozen=True, slots=True)
class Terms:
    """Terms of a reward, each in [0, 1].

    Attributes:
        speed: r_v.
        deviation: r_d.
        angle: r_alpha.
    """

    speed: float
    deviation: float
    angle: float


def terms(speed: float, pace: Pace, deviation: float, angle: float) -> Terms:
    """The terms of one moment.

    Args:
        speed: m/s.
        pace: v_min, v_target and v_max.
        deviation: Distance to the path, m, signed or not.
        angle: Heading to the path's, rad, signed or not.
    """
    return Terms(speed_term(speed, pace), deviation_term(deviation), angle_term(angle))


def speed_term(speed: float, pace: Pace) -> float:
    """r_v: rises to 1 at v_min, falls from v_target to 0 at v_max."""
    if speed < pace.least:
        return speed / pace.least
    if speed < pace.target:
        return 1.0
    return max(1.0 - (speed - pace.target) / (pace.most - pace.target), 0.0)


def deviation_term(deviation: float) -> float:
    """r_d: 1 on the path, 0 from 3 m on."""
    return max(1.0 - abs(deviation) / FARTHEST_M, 0.0)


def angle_term(angle: float) -> float:
    """r_alpha: 1 along the path, 0 from 90 degrees on."""
    return max(1.0 - abs(angle) / WIDEST_RAD, 0.0)


def reward(found: Terms, infraction: bool, form: Form = "product") -> float:
    """The reward of one tick, in [0, 1], or -10.

    Args:
        found: Of the tick.
        infraction: Whether there was one.
        form: "product", or "sum": the mean of the three, which has the same scale; the thesis found it worse.
    """
    if infraction:
        return INFRACTION
    shares = [share * share for share in (found.speed, found.deviation, found.angle)]
    return math.prod(shares) if form == "product" else sum(shares) / len(shares)
