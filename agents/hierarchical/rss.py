"""RSS: the distances that keep the ego out of accidents of its own making, and when they are violated.

Everything is in the frame of the ego's path: longitudinal along it, lateral across it. A situation is dangerous where
the longitudinal *and* the lateral distance to the same actor are too short; longitudinal alone is a neighbour lane,
lateral alone a leader. Who crosses the path keeps going: the ego must be able to stop before the other is in its way.
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
    """What everybody is assumed to do at worst.

    Attributes:
        reaction_s: Until a response shows, s.
        acceleration: Most that a vehicle accelerates during it, m/s^2.
        braking: Least with which whoever must respond brakes, m/s^2.
        hardest_braking: Most with which whoever is ahead may brake, m/s^2.
        side_acceleration: Most towards the side during the reaction, m/s^2.
        side_braking: Least with which a motion to the side is stopped, m/s^2.
        side_margin_m: What stays between two vehicles side by side, m.
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
        """The same for the kernels."""
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
"""Ours, from what the ego is: it decides every 0.1 s, its drive and brakes lag by 0.1 s, traction and hardest braking
are those of `VehicleParameters`, heavy rain leaves a grip of 0.6 x 0.9 x g = 5.3 m/s^2. To the side as `LITERATURE`."""
LITERATURE = RssConstants(
    reaction_s=0.5,
    acceleration=3.5,
    braking=4.0,
    hardest_braking=8.0,
    side_acceleration=0.2,
    side_braking=0.8,
    side_margin_m=0.1,
)
"""Common choices for cars in town; the thesis gives none. Asks for 16 m behind who drives 10 m/s, more than SUMO's."""
CONSTANTS: Mapping[str, RssConstants] = MappingProxyType({"rss": EGO, "rss-literature": LITERATURE})


@njit(cache=True)
def behind_distance(rear: float, front: float, c: Numbers) -> float:
    """Least gap to whoever drives ahead in the same direction, m.

    The rear one accelerates until it reacts, then brakes as little as it must; the front one brakes as hard as it can.

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
    """Least gap between two who drive towards each other, m: both accelerate until they react, then brake.

    Args:
        one: Speed of the one, m/s.
        other: Speed of the other, m/s.
        c: The constants.

    Source: the same, definition 2, with one braking for both: here nobody knows who is on the wrong side.
    """
    return behind_distance(one, 0.0, c) + behind_distance(other, 0.0, c)


@njit(cache=True)
def side_distance(one: float, other: float, c: Numbers) -> float:
    """Least gap between two side by side, m.

    Args:
        one: Speed of the one towards the other, m/s; negative away from it.
        other: Speed of the other towards the one, m/s.
        c: The constants.

    Source: the same, definition 6. Its formula adds the way that somebody who moves away needs to stop moving away;
    here that is no way towards the other.
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
    """Least gap across the path to whoever crosses it, m: it keeps its speed until the ego stands.

    Args:
        ego: Speed of the ego, m/s.
        towards: Speed of the other towards the path, m/s; negative where it leaves.
        gives_way: Whether it must let the ego pass; then it is only asked to be able to brake.
        c: The constants.

    Source: ours; RSS leaves who walks or turns in front to "other" geometry. Its rule for junctions, that who must give
    way is dangerous only once it can no longer stop, is kept.
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
    """The gaps to every actor, and how large they must be.

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
    """(N,) each, bool: who is too near longitudinally, and who laterally; a situation is dangerous where both hold.

    Whoever is behind is left to keep its own distance.
    """
    too_near = (judged[:, GAP] >= 0.0) & (judged[:, GAP] < judged[:, LEAST])
    return too_near, judged[:, SIDE_GAP] < judged[:, SIDE_LEAST]
