"""RSS: safe distances, and their violations.

Everything is in the frame of the ego's path: longitudinal along it, lateral across it. A situation is dangerous where
the longitudinal *and* the lateral distance to the same actor are too short; longitudinal alone is a neighbour lane,
lateral alone a leader. Crossing actors keep their speed: the ego must be able to stop before them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.config import Config

Positive = Annotated[float, Field(gt=0)]

S_LOW, S_HIGH, D_LOW, D_HIGH, SPEED, ALONG, ACROSS, GIVES_WAY = range(8)
COLUMNS = 8
"""An actor: ends of its box along the path and across it, from the ego's centre and the path's middle [m], speed [m/s],
cosine and sine of its heading to the path's, whether it must give way to the ego (0 or 1)."""
GAP, LEAST, SIDE_GAP, SIDE_LEAST = range(4)
JUDGED = 4
CROSSES = math.sin(math.radians(30.0))


class RssConstants(Config):
    """Assumed worst behaviour of all actors.

    Attributes:
        reaction_s: Time until a response, s.
        acceleration: Highest acceleration during the reaction, m/s^2.
        braking: Least deceleration of the responding vehicle, m/s^2.
        hardest_braking: Hardest deceleration of the vehicle ahead, m/s^2.
        side_acceleration: Highest lateral acceleration during the reaction, m/s^2.
        side_braking: Least deceleration of a lateral motion, m/s^2.
        side_margin_m: Remaining distance between two vehicles side by side, m.
    """

    reaction_s: Positive
    acceleration: Positive
    braking: Positive
    hardest_braking: Positive
    side_acceleration: Positive
    side_braking: Positive
    side_margin_m: Positive

    @property
    def numbers(self) -> Numbers:
        """Constants as the kernels take them."""
        return Numbers(*self.model_dump().values())


class Numbers(NamedTuple):
    """See `RssConstants`."""

    reaction: float
    acceleration: float
    braking: float
    hardest: float
    side_acceleration: float
    side_braking: float
    margin: float


EGO = RssConstants(
    reaction_s=0.3,
    acceleration=4.0,
    braking=5.0,
    hardest_braking=8.0,
    side_acceleration=0.2,
    side_braking=0.8,
    side_margin_m=0.2,
)
"""Ours, from the ego's properties: it decides every 0.1 s, its drive and brakes lag by 0.1 s. Traction and hardest
braking are those of `VehicleParameters`, heavy rain leaves a grip of 0.6 x 0.9 x g = 5.3 m/s^2. Laterally as
`LITERATURE`."""
LITERATURE = RssConstants(
    reaction_s=0.5,
    acceleration=3.5,
    braking=4.0,
    hardest_braking=8.0,
    side_acceleration=0.2,
    side_braking=0.8,
    side_margin_m=0.1,
)
"""Common choices for cars in town; the thesis gives none. At 10 m/s they need 16 m, more than SUMO's drivers keep."""
CONSTANTS: Mapping[str, RssConstants] = MappingProxyType({"rss": EGO, "rss-literature": LITERATURE})


@njit(cache=True)
def behind_distance(rear: float, front: float, c: Numbers) -> float:
    """Least gap to a vehicle ahead in the same direction, m.

    The rear one accelerates until it reacts, then brakes with the least deceleration; the front one brakes hardest.

    Args:
        rear: Speed of the one behind, m/s.
        front: Speed of the one ahead, m/s.
        c: The constants.

    Source: Shalev-Shwartz, Shammah, Shashua 2017, definition 1; thesis section 6.
    """
    reached = rear + c.reaction * c.acceleration
    stops = rear * c.reaction + 0.5 * c.acceleration * c.reaction**2 + reached**2 / (2.0 * c.braking)
    return max(stops - front**2 / (2.0 * c.hardest), 0.0)


@njit(cache=True)
def oncoming_distance(one: float, other: float, c: Numbers) -> float:
    """Least gap between two vehicles towards each other, m: both accelerate until they react, then brake.

    Args:
        one: Speed of the one, m/s.
        other: Speed of the other, m/s.
        c: The constants.

    Source: the same, definition 2, with equal braking of both, since it is not known which one is on the wrong side.
    """
    return behind_distance(one, 0.0, c) + behind_distance(other, 0.0, c)


@njit(cache=True)
def side_distance(one: float, other: float, c: Numbers) -> float:
    """Least gap between two side by side, m.

    Args:
        one: Speed of the one towards the other, m/s; negative away from it.
        other: Speed of the other towards the one, m/s.
        c: The constants.

    Source: the same, definition 6. Its formula adds the distance that a vehicle moving away needs to stop that motion;
    here this distance does not count.
    """
    return c.margin + _sideways(one, c) + _sideways(other, c)


@njit(cache=True)
def _sideways(speed: float, c: Numbers) -> float:
    reached = speed + c.reaction * c.side_acceleration
    if reached <= 0.0:
        return 0.0
    return max(0.5 * (speed + reached) * c.reaction + reached**2 / (2.0 * c.side_braking), 0.0)


@njit(cache=True)
def crossing_distance(ego: float, towards: float, gives_way: bool, c: Numbers) -> float:
    """Least gap across the path to a crossing actor, m: it keeps its speed until the ego stands.

    Args:
        ego: Speed of the ego, m/s.
        towards: Speed of the other towards the path, m/s; negative where it leaves.
        gives_way: Whether it must yield to the ego; then it only has to be able to brake.
        c: The constants.

    Source: ours; RSS treats walking or turning in front as "other" geometry. Its rule for junctions is kept: an actor
    that must yield is dangerous only once it can no longer stop.
    """
    if towards <= 0.0:
        return c.margin
    seconds = c.reaction + (ego + c.reaction * c.acceleration) / c.braking
    covers = towards * seconds
    return c.margin + (min(covers, towards**2 / (2.0 * c.braking)) if gives_way else covers)


@njit(cache=True)
def judge(
    speed: float, sideways: float, offset: float, half_length: float, half_width: float, actors: FloatArray, c: Numbers
) -> FloatArray:
    """Gaps to every actor, and their least sizes.

    Args:
        speed: Of the ego along its path, m/s.
        sideways: Of the ego, to the left of its path, m/s.
        offset: Of the ego, to the left of the path, m.
        half_length: Of the ego, m.
        half_width: Of the ego, m.
        actors: (N, 8), see `COLUMNS`.
        c: The constants.

    Returns:
        (N, 4) longitudinal gap [m, negative where the other is behind, 0 beside], least size of it [m], lateral gap
        [m], least size of it [m].
    """
    out = np.empty((actors.shape[0], JUDGED))
    for n in range(actors.shape[0]):
        row = actors[n]
        v_s, v_d = row[SPEED] * row[ALONG], row[SPEED] * row[ACROSS]
        if row[S_LOW] > half_length:
            out[n, GAP] = row[S_LOW] - half_length
            out[n, LEAST] = behind_distance(speed, v_s, c) if v_s >= 0.0 else oncoming_distance(speed, -v_s, c)
        elif row[S_HIGH] < -half_length:
            out[n, GAP] = row[S_HIGH] + half_length
            out[n, LEAST] = behind_distance(v_s, speed, c) if v_s > 0.0 else 0.0
        else:
            out[n, GAP], out[n, LEAST] = 0.0, math.inf
        left, right = row[D_LOW] - offset - half_width, offset - half_width - row[D_HIGH]
        sign = 1.0 if left > right else -1.0
        out[n, SIDE_GAP] = max(left, right, 0.0)
        if abs(row[ACROSS]) > CROSSES and row[SPEED] > 0.1:
            out[n, SIDE_LEAST] = crossing_distance(speed, -sign * v_d, row[GIVES_WAY] > 0.0, c)
        else:
            out[n, SIDE_LEAST] = side_distance(sign * sideways, -sign * v_d, c)
    return out


def dangerous(judged: FloatArray) -> tuple[BoolArray, BoolArray]:
    """(N,) bool each: too near longitudinally, too near laterally; a situation is dangerous where both hold.

    Actors behind have to keep their own distance.
    """
    too_near = (judged[:, GAP] >= 0.0) & (judged[:, GAP] < judged[:, LEAST])
    return too_near, judged[:, SIDE_GAP] < judged[:, SIDE_LEAST]
