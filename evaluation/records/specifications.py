"""Specifications of all statuses and kinds of infraction: the one table from which everything else derives.

Scores read the penalties, the judge the endings, records the units; reports and the dashboard read labels and marks. A
new kind is one entry here and a criterion in `evaluation/criteria/`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Final, Literal

Unit = Literal["m/s", "m", "%", "s"]
Hatch = Literal["", "/", "x", "."]


class Outcome(StrEnum):
    """Meaning of a status for the agent; every page has a colour of this name."""

    SUCCESS = "success"
    """The goal was reached, or the scenario ended as planned."""
    INFRACTION = "infraction"
    """The agent failed as a driver."""
    WARNING = "warning"
    """The agent failed as a program."""
    INFRASTRUCTURE = "infrastructure"
    """The simulation failed, which says nothing about the agent."""


class Status(StrEnum):
    """Status with which an ego's episode ended; FINISHED: the scenario was over before the goal, as planned."""

    PERFECT = "perfect"
    COMPLETED = "completed"
    FINISHED = "finished"
    COLLIDED = "failed: collision"
    DEVIATED = "failed: agent deviated from the route"
    BLOCKED = "failed: agent got blocked"
    TIMED_OUT = "failed: agent ran out of time"
    AGENT_SETUP = "failed: agent could not be set up"
    AGENT_RAISED = "failed: agent raised"
    AGENT_ACTION = "failed: agent's action was invalid"
    AGENT_DEADLINE = "failed: agent did not answer in time"
    SIMULATION = "lost: simulation failed"
    GRIDLOCK = "lost: traffic was gridlocked"

    @property
    def outcome(self) -> Outcome:
        """The outcome that the status means for the agent."""
        return _ENDINGS[self][0]

    @property
    def hatch(self) -> Hatch:
        """Pattern of its bar in a figure, distinct within its outcome."""
        return _ENDINGS[self][1]

    @property
    def completed(self) -> bool:
        """Whether the goal was reached."""
        return self in (Status.PERFECT, Status.COMPLETED)

    @property
    def agent_fault(self) -> bool:
        """Whether the agent failed as a program."""
        return self.outcome is Outcome.WARNING

    @property
    def infrastructure_fault(self) -> bool:
        """Whether the episode says nothing about the agent."""
        return self.outcome is Outcome.INFRASTRUCTURE

    @property
    def worth_another_try(self) -> bool:
        """Whether driving the episode again may end otherwise; a gridlock does not, since it follows from the seed."""
        return self is Status.SIMULATION


class InfractionKind(StrEnum):
    """Kinds of infraction, in the order in which criteria are evaluated and pages list them."""

    COLLISION_PEDESTRIAN = "collision_pedestrian"
    COLLISION_VEHICLE = "collision_vehicle"
    COLLISION_STATIC = "collision_static"
    RED_LIGHT = "red_light"
    STOP_SIGN = "stop_sign"
    OUTSIDE_LANES = "outside_lanes"
    MINIMUM_SPEED = "minimum_speed"
    SCENARIO_TIMEOUT = "scenario_timeout"
    YIELD_EMERGENCY = "yield_emergency"
    ROUTE_DEVIATION = "route_deviation"
    BLOCKED = "blocked"
    ROUTE_TIMEOUT = "route_timeout"
    GRIDLOCK = "gridlock"

    @property
    def specification(self) -> Specification:
        """The specification of the kind."""
        return SPECIFICATIONS[self]


@dataclass(frozen=True, slots=True)
class Penalty:
    """Constant penalty of each infraction of a kind in the driving score.

    Attributes:
        factor: Factor p under rules 1.0 and 2.0, in (0, 1].
        cost: Cost c under rules 2.1, at least 0.
    """

    factor: float
    cost: float

    def factor_of(self, magnitude: float) -> float:
        """Factor p of an infraction of this size."""
        return self.factor

    def cost_of(self, magnitude: float) -> float:
        """Cost c of an infraction of this size."""
        return self.cost


@dataclass(frozen=True, slots=True)
class ShortfallPenalty:
    """Penalty in proportion to the difference from 100 %.

    With s = magnitude / 100, p = 1 - factor_weight (1 - s) and c = cost_weight (1 - s).
    """

    factor_weight: float
    cost_weight: float

    def factor_of(self, magnitude: float) -> float:
        """Factor p of an infraction of this size, %."""
        return 1.0 - self.factor_weight * _missing(magnitude)

    def cost_of(self, magnitude: float) -> float:
        """Cost c of an infraction of this size, %."""
        return self.cost_weight * _missing(magnitude)


@dataclass(frozen=True, slots=True)
class Mark:
    """How a kind of infraction is drawn on every page.

    Attributes:
        symbol: Name of the plotly symbol.
        path: The same shape as an SVG path within -5..5, y down.
    """

    symbol: str
    path: str


@dataclass(frozen=True, slots=True)
class Specification:
    """All properties of one kind of infraction.

    Attributes:
        label: Name of the kind, for people.
        unit: Unit of the magnitude.
        mark: Mark on every page.
        penalty: Penalty in the driving score; None if the kind has none, or enters in another way.
        since: First version of the leaderboard's rules with this kind.
        ends: Status of an ego whose episode the infraction ends; None if the ego drives on.
        collision: Whether the infraction is a collision.
    """

    label: str
    unit: Unit
    mark: Mark
    penalty: Penalty | ShortfallPenalty | None = None
    since: Literal["1.0", "2.0"] = "1.0"
    ends: Status | None = None
    collision: bool = False


_ENDINGS: Final[Mapping[Status, tuple[Outcome, Hatch]]] = MappingProxyType(
    {
        Status.PERFECT: (Outcome.SUCCESS, ""),
        Status.COMPLETED: (Outcome.SUCCESS, "/"),
        Status.FINISHED: (Outcome.SUCCESS, "x"),
        Status.COLLIDED: (Outcome.INFRACTION, ""),
        Status.DEVIATED: (Outcome.INFRACTION, "x"),
        Status.BLOCKED: (Outcome.INFRACTION, "/"),
        Status.TIMED_OUT: (Outcome.INFRACTION, "."),
        Status.AGENT_SETUP: (Outcome.WARNING, ""),
        Status.AGENT_RAISED: (Outcome.WARNING, "x"),
        Status.AGENT_ACTION: (Outcome.WARNING, "/"),
        Status.AGENT_DEADLINE: (Outcome.WARNING, "."),
        Status.SIMULATION: (Outcome.INFRASTRUCTURE, "/"),
        Status.GRIDLOCK: (Outcome.INFRASTRUCTURE, "x"),
    }
)


SPECIFICATIONS: Final[Mapping[InfractionKind, Specification]] = MappingProxyType(
    {
        InfractionKind.COLLISION_PEDESTRIAN: Specification(
            label="pedestrian hit",
            unit="m/s",
            mark=Mark("circle", "M-4.5 0a4.5 4.5 0 1 0 9 0a4.5 4.5 0 1 0-9 0z"),
            penalty=Penalty(factor=0.50, cost=1.0),
            collision=True,
        ),
        InfractionKind.COLLISION_VEHICLE: Specification(
            label="vehicle hit",
            unit="m/s",
            mark=Mark("square", "M-4-4h8v8h-8z"),
            penalty=Penalty(factor=0.60, cost=0.7),
            collision=True,
        ),
        InfractionKind.COLLISION_STATIC: Specification(
            label="obstacle hit",
            unit="m/s",
            mark=Mark("triangle-up", "M0-5 5 4h-10z"),
            penalty=Penalty(factor=0.65, cost=0.6),
            collision=True,
        ),
        InfractionKind.RED_LIGHT: Specification(
            label="red light run",
            unit="m/s",
            mark=Mark("diamond", "M0-5.5 5 0 0 5.5-5 0z"),
            penalty=Penalty(factor=0.70, cost=0.4),
        ),
        InfractionKind.STOP_SIGN: Specification(
            label="stop sign run",
            unit="m/s",
            mark=Mark("star", "M0-5.6 1.4-1.9 5.3-1.7 2.3 0.7 3.3 4.5 0 2.4-3.3 4.5-2.3 0.7-5.3-1.7-1.4-1.9z"),
            penalty=Penalty(factor=0.80, cost=0.25),
        ),
        # No penalty: it enters the scores as metres outside per metre of route completed.
        InfractionKind.OUTSIDE_LANES: Specification(
            label="outside lanes", unit="m", mark=Mark("bowtie", "M-5-4.5 5 4.5v-9l-10 9z")
        ),
        InfractionKind.MINIMUM_SPEED: Specification(
            label="too slow",
            unit="%",
            mark=Mark("triangle-down", "M0 5 5-4h-10z"),
            penalty=ShortfallPenalty(factor_weight=0.3, cost_weight=0.4),
            since="2.0",
        ),
        InfractionKind.SCENARIO_TIMEOUT: Specification(
            label="event not over",
            unit="s",
            mark=Mark("pentagon", "M0-5.3 5-1.6 3.1 4.3h-6.2L-5-1.6z"),
            penalty=Penalty(factor=0.70, cost=0.4),
            since="2.0",
        ),
        InfractionKind.YIELD_EMERGENCY: Specification(
            label="did not yield",
            unit="m",
            mark=Mark("hexagon", "M0-5.4 4.7-2.7v5.4L0 5.4-4.7 2.7v-5.4z"),
            penalty=Penalty(factor=0.70, cost=0.4),
            since="2.0",
        ),
        InfractionKind.ROUTE_DEVIATION: Specification(
            label="left the route",
            unit="m",
            mark=Mark("x", "M-5-3-3-5 0-2 3-5 5-3 2 0 5 3 3 5 0 2-3 5-5 3-2 0z"),
            ends=Status.DEVIATED,
        ),
        InfractionKind.BLOCKED: Specification(
            label="blocked",
            unit="s",
            mark=Mark("cross", "M-1.7-5h3.4v3.3h3.3v3.4h-3.3v3.3h-3.4v-3.3h-3.3v-3.4h3.3z"),
            ends=Status.BLOCKED,
        ),
        InfractionKind.ROUTE_TIMEOUT: Specification(
            label="out of time",
            unit="s",
            mark=Mark("hourglass", "M-4.5-5h9l-9 10h9z"),
            ends=Status.TIMED_OUT,
        ),
        InfractionKind.GRIDLOCK: Specification(
            label="gridlock",
            unit="s",
            mark=Mark("hash", "M-5-2.5h10v1h-10zM-5 1.5h10v1h-10zM-2.5-5h1v10h-1zM1.5-5h1v10h-1z"),
            ends=Status.GRIDLOCK,
        ),
    }
)
"""Source of factors and costs: CARLA Leaderboard 1.0, 2.0 and 2.1."""

COLLISIONS: Final = frozenset(kind for kind in InfractionKind if kind.specification.collision)


def _missing(percent: float) -> float:
    """Difference from 100 % as a share in [0, 1]."""
    return 1.0 - min(max(percent, 0.0), 100.0) / 100.0
