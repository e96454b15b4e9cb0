"""Pace: speed of a careful driver, and the reasons that limit it. The reward of sub-policies depends on it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from dohyo.agents.planning.crossing import crossers
from dohyo.agents.planning.surroundings import Surroundings
from dohyo.agents.rules.rules_only import advised_speed
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import BoolArray, Float32Array
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.sensors.path import BEHIND
from dohyo.sumo_networks.world import ActorKind, LightState

LEAST_SHARE = 0.8
OVER_LIMIT = 0.2
BRAKING_M_S2 = 2.0
STANDS_BELOW_M_S = 0.5
SIDE_MARGIN_M = 0.3
FOLLOWING_GAP_M, FOLLOWING_S, FOLLOWING_GAIN = 2.5, 1.0, 0.5
LINE_GAP_M, LINE_GAIN = 2.0, 0.7
YIELD_GAP_M, YIELD_S, YIELD_SIGHT_M = 2.0, 4.0, 40.0
HELD_M = 10.0
_CAR = VehicleParameters()


class Restraint(StrEnum):
    """Reasons to slow down, besides limits and curves."""

    LEADER = "leader"
    LINE = "line"
    YIELD = "yield"


@dataclass(frozen=True, slots=True)
class Pace:
    """Speeds, m/s: v_min, v_target and v_max of the thesis's equation 6.2.

    Attributes:
        least: Slower is too slow: 0.8 of the target.
        target: What a careful driver would hold.
        most: Speed with reward 0: a fifth above the limit for any target, so that braking pays from its first
            tick.
        stop_m: Distance from the ego's front to its stopping place, m; infinite without one.
    """

    least: float
    target: float
    most: float
    stop_m: float = math.inf

    @property
    def held(self) -> bool:
        """Whether standing here is lawful: within 10 m of what the ego must stand before."""
        return self.stop_m < HELD_M


def pace_of(observation: Observation, around: Surroundings, restraints: frozenset[Restraint]) -> Pace:
    """The pace of one moment.

    Args:
        observation: With the sensors "route", "path", "junctions_ahead" and "conflicts"; the path is the one to
            be followed.
        around: Made of the observation.
        restraints: Those that count.
    """
    limits = list(_lines(observation["junctions_ahead"])) if Restraint.LINE in restraints else []
    if Restraint.LEADER in restraints:
        limits += _leaders(around)
    if Restraint.YIELD in restraints:
        limits += yields(observation["conflicts"], around)
    target = min((speed for speed, _ in limits), default=math.inf)
    target = min(target, advised_speed(observation["route"]))
    if target < STANDS_BELOW_M_S:
        target = 0.0
    most = max(target, float(observation["path"][BEHIND, 4])) * (1.0 + OVER_LIMIT)
    stop = min((distance for _, distance in limits), default=math.inf)
    return Pace(LEAST_SHARE * target, target, most, stop)


def following_speed(gap: float, pace: float) -> float:
    """Speed behind a leader, m/s: closes a gap [m] beyond 2.5 m and 1 s, and can always stop gently.

    Args:
        gap: Between the bumpers, m.
        pace: Speed of the leader along the path, m/s.
    """
    pace = max(pace, 0.0)
    closing = pace + FOLLOWING_GAIN * (gap - FOLLOWING_GAP_M - FOLLOWING_S * pace)
    stopping = math.sqrt(pace**2 + 2.0 * BRAKING_M_S2 * max(gap - FOLLOWING_GAP_M, 0.0))
    return max(min(closing, stopping), 0.0)


def stopping_speed(distance: float, gap: float) -> float:
    """Speed from which the ego stops a gap before a point so far ahead, m/s; never braking by more than 4 m/s^2."""
    left = max(distance - gap, 0.0)
    return min(math.sqrt(2.0 * BRAKING_M_S2 * left), LINE_GAIN * left)


def closed(junctions: Float32Array) -> BoolArray:
    """(N,) whether a line is ahead, and its light red or yellow; `junctions`: (N, 4), see `sensors.junctions_ahead`.

    A yellow light counts however near its line is. A line behind the front does not count.
    """
    stops: BoolArray = (junctions[:, 2] == LightState.RED) | (junctions[:, 2] == LightState.YELLOW)
    return stops & (junctions[:, 0] > 0.0)


def coming(conflicts: Float32Array) -> BoolArray:
    """(N,) whether an actor is about to cross the way within sight; `conflicts`: (N, 8), see `sensors.conflicts`."""
    enter, other_enter, speed, kind = conflicts[:, (0, 2, 4, 6)].T
    soon: BoolArray = (other_enter <= 0.0) | (other_enter < YIELD_S * speed)
    here: BoolArray = (kind >= 0) & (enter > 0.0) & (enter < YIELD_SIGHT_M)
    return here & soon


# Each restraint: the speed it allows [m/s], and how far ahead the ego must stand [m].


def _leaders(around: Surroundings) -> Iterator[tuple[float, float]]:
    reach, half = 0.5 * _CAR.width + SIDE_MARGIN_M, 0.5 * _CAR.length
    for one in around.neighbours:
        if one.s_high > half and one.within(-reach, reach):
            gap, pace = max(one.s_low - half, 0.0), one.speed * one.along
            yield following_speed(gap, pace), gap if pace < STANDS_BELOW_M_S else math.inf


def _lines(junctions: Float32Array) -> Iterator[tuple[float, float]]:
    for distance in junctions[closed(junctions), 0].tolist():
        yield stopping_speed(distance, LINE_GAP_M), distance


def yields(conflicts: Float32Array, around: Surroundings) -> Iterator[tuple[float, float]]:
    """Restraints by crossing pedestrians, and by near vehicles with the right of way.

    Args:
        conflicts: (16, 8), see `sensors.conflicts`.
        around: Of the same moment.

    Yields:
        For each the speed that it allows [m/s], and how far ahead the ego must stand [m].
    """
    unforeseen = crossers(around, 0.5 * _CAR.length, 0.5 * _CAR.width)
    rows = np.concatenate((unforeseen, conflicts))
    first = (rows[:, 5] > 0.0) | (rows[:, 6] == ActorKind.PEDESTRIAN)
    for enter in rows[coming(rows) & first, 0].tolist():
        yield stopping_speed(enter, YIELD_GAP_M), enter
