"""Manoeuvres: the five options of GHRL, when each may begin, which path it follows, and when it is over."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType

from dohyo.agents.hierarchical.environments.pace import Restraint, yields
from dohyo.agents.planning.sidestep import Sidestep
from dohyo.agents.planning.surroundings import LaneBeside, Surroundings
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.sensors.path import BEHIND
from dohyo.sumo_networks.world import LightState

SIDE_M_S2 = 2.0
LEAST_RAMP_M = 15.0
AHEAD_M = 40.0
STRIP_MARGIN_M = 0.3
FREE_AHEAD_M, FREE_BEHIND_M, FREE_S = 12.0, 8.0, 2.0
LIGHT_AHEAD_M, LINE_NEAR_M, YIELD_NEAR_M = 60.0, 35.0, 30.0
THERE_M, THERE_RAD = 0.4, 0.1
_CAR = VehicleParameters()


class Manoeuvre(StrEnum):
    """Purpose of a sub-policy."""

    LANE = "lane"
    LEFT = "left"
    RIGHT = "right"
    BRAKING = "braking"
    LIGHTS = "lights"


CHANGES = (Manoeuvre.LEFT, Manoeuvre.RIGHT)
DRIVE = "drive"
"""All of them in one mission: what the master and the flat policy learn."""
RESTRAINTS: Mapping[Manoeuvre, frozenset[Restraint]] = MappingProxyType(
    {
        Manoeuvre.LANE: frozenset({Restraint.LEADER}),
        Manoeuvre.LEFT: frozenset({Restraint.LEADER}),
        Manoeuvre.RIGHT: frozenset({Restraint.LEADER}),
        Manoeuvre.BRAKING: frozenset({Restraint.LEADER, Restraint.YIELD}),
        Manoeuvre.LIGHTS: frozenset({Restraint.LEADER, Restraint.YIELD, Restraint.LINE}),
    }
)
"""Restraints that each manoeuvre must respect; its reward ignores the others."""


def restraints_of(what: str) -> frozenset[Restraint]:
    """Restraints that a manoeuvre must respect; for "drive", all of them."""
    return frozenset(Restraint) if what == DRIVE else RESTRAINTS[Manoeuvre(what)]


class Course:
    """The path that the ego follows: its route, or the lane beside it after a change."""

    def __init__(self) -> None:
        self._aside = Sidestep()
        self._around: Surroundings | None = None
        self._sides: list[LaneBeside] | None = None

    @property
    def offset(self) -> float:
        """Target offset, m to the left of the route."""
        return self._aside.offset

    def look(self, around: Surroundings) -> None:
        """Updates by one tick.

        Args:
            around: Along the route, not along this path.
        """
        self._around, self._sides = around, None

    def seen(self, observation: Observation) -> Observation:
        """Observation with this path instead of the route's."""
        progress = float(observation["navigation"][2])
        if not self._aside.aside(progress):
            return observation
        route = self._aside.applied(observation["route"], progress)
        path = self._aside.applied(observation["path"], progress, BEHIND)
        return {**observation, "route": route, "path": path}

    def beside(self, manoeuvre: Manoeuvre) -> float | None:
        """Offset of the lane that a change leads to, m to the left of the route; None without such a lane.

        Args:
            manoeuvre: LEFT or RIGHT.
        """
        left = manoeuvre is Manoeuvre.LEFT
        if self.offset != 0.0:
            return 0.0 if left == (self.offset < 0.0) else None
        lanes = [lane.d for lane in self._lanes_beside() if not lane.oncoming and (lane.d > 0.0) == left]
        return lanes[0] if lanes else None

    def free(self, manoeuvre: Manoeuvre, speed: float) -> bool:
        """Whether a change may begin: there is a lane, and no traffic in it that the ego would hinder."""
        offset = self.beside(manoeuvre)
        return offset is not None and self._around is not None and lane_is_free(self._around, offset, speed)

    def begin(self, manoeuvre: Manoeuvre, progress: float, speed: float) -> bool:
        """Leads into the lane beside; returns False, without a change, if there is none."""
        offset = self.beside(manoeuvre)
        if offset is None:
            return False
        self._lead(offset, progress, speed)
        return True

    def keep_to_roads(self, progress: float, speed: float) -> None:
        """Leads back to the route if the lane beside it ends."""
        if self.offset == 0.0:
            return
        if not any(abs(lane.d - self.offset) < 0.5 * lane.width for lane in self._lanes_beside()):
            self._lead(0.0, progress, speed)

    def _lead(self, offset: float, progress: float, speed: float) -> None:
        across = abs(offset - self._aside.at(progress))
        self._aside.lead(offset, progress, max(speed * math.sqrt(6.0 * across / SIDE_M_S2), LEAST_RAMP_M))

    def _lanes_beside(self) -> list[LaneBeside]:
        """Lanes beside the route for some distance; computed at most once per tick."""
        if self._sides is None:
            self._sides = [] if self._around is None else self._around.lanes_beside(0.0, AHEAD_M)
        return self._sides

    def arrived(self, observation: Observation) -> bool:
        """Whether the ego is in the lane that this path leads to, and along it.

        Args:
            observation: As the sensors gave it.
        """
        progress = float(observation["navigation"][2])
        if abs(self._aside.at(progress) - self.offset) > THERE_M:
            return False
        lateral, angle = deviation(self.seen(observation)["path"])
        return abs(lateral) < THERE_M and abs(angle) < THERE_RAD


def deviation(path: Float32Array) -> tuple[float, float]:
    """Distance of the ego to the left of a path [m], and its heading to the path's [rad].

    Args:
        path: (192, 6), see `sensors.path`.
    """
    x, y, heading = (float(v) for v in path[BEHIND, :3])
    return x * math.sin(heading) - y * math.cos(heading), -heading


def lane_is_free(around: Surroundings, offset: float, speed: float) -> bool:
    """Whether a lane is free: no actor beside the ego, none that would have to brake, none too near ahead.

    Args:
        around: Along the route.
        offset: Middle of the lane, m to the left of the route.
        speed: Of the ego, m/s.
    """
    half = 0.5 * _CAR.width + STRIP_MARGIN_M
    for one in around.neighbours:
        if not one.within(offset - half, offset + half):
            continue
        pace = one.speed * one.along
        behind = FREE_BEHIND_M + FREE_S * max(pace - speed, 0.0)
        ahead = FREE_AHEAD_M + FREE_S * max(speed - pace, 0.0)
        if -behind < one.s_high and one.s_low < ahead:
            return False
    return True


def light_ahead(junctions: Float32Array) -> bool:
    """Whether the next junction with lights is near, and the ego has not left it yet.

    Args:
        junctions: (4, 4), see `sensors.junctions_ahead`.
    """
    return any(row[2] >= LightState.OFF and row[0] < LIGHT_AHEAD_M for row in junctions)


def line_near(junctions: Float32Array) -> bool:
    """Whether a light that is not green is so near that only `LIGHTS` was trained for it.

    Args:
        junctions: (4, 4), see `sensors.junctions_ahead`.
    """
    return any(0.0 < row[0] < LINE_NEAR_M and int(row[2]) in (LightState.RED, LightState.YELLOW) for row in junctions)


def must_yield(conflicts: Float32Array, around: Surroundings) -> bool:
    """Whether a pedestrian, or traffic with the right of way, is about to cross the way nearby.

    Args:
        conflicts: (16, 8), see `sensors.conflicts`.
        around: Of the same moment.
    """
    return any(distance < YIELD_NEAR_M for _, distance in yields(conflicts, around))


def learned(observation: Observation, around: Surroundings) -> frozenset[Manoeuvre]:
    """Manoeuvres whose exercises contain such situations: the initiation sets.

    Before a closed line this is `LIGHTS` alone; before traffic to yield to, `LIGHTS` and `BRAKING`.

    Args:
        observation: With the sensors "junctions_ahead" and "conflicts".
        around: Made of the observation.
    """
    lights = {Manoeuvre.LIGHTS} if light_ahead(observation["junctions_ahead"]) else set()
    if line_near(observation["junctions_ahead"]):
        return frozenset(lights)
    if must_yield(observation["conflicts"], around):
        return frozenset(lights | {Manoeuvre.BRAKING})
    return frozenset(lights | {Manoeuvre.BRAKING, Manoeuvre.LANE, *CHANGES})
