"""Endings: conditions that end an episode of a sub-policy, and whether it failed.

The thesis ends training episodes after 5 s below 1 km/h and 2.5 m from the path's middle, and names no collision, on
which NoCrash fails; ours end on that too. A lawful stop, such as before a red light, does not count as standing.
"""

from __future__ import annotations

import math
from enum import StrEnum

from dohyo.agents.hierarchical.options.manoeuvres import CHANGES, DRIVE, Manoeuvre
from dohyo.evaluation.criteria import Criterion
from dohyo.evaluation.criteria.collision import Collision
from dohyo.evaluation.criteria.red_light import RedLight
from dohyo.evaluation.criteria.stop_sign import StopSign
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import EventPhase, World

STANDING_M_S, STANDING_S = 1.0 / 3.6, 5.0
FARTHEST_M = 2.5
HOLD_S = 2.0
RESUMED_M, LEFT_JUNCTION_M = 15.0, 10.0


class End(StrEnum):
    """Why an episode ended."""

    INFRACTION = "infraction"
    STANDING = "standing"
    DONE = "done"
    TIME = "time"


def criteria_of(what: str) -> tuple[Criterion, ...]:
    """Infractions that cost -10: collisions always, lights only if they are the task."""
    if what in (Manoeuvre.LIGHTS, DRIVE):
        return (Collision(), RedLight(), StopSign())
    return (Collision(),)


class Endings:
    """Watches one episode.

    Attributes:
        end: Cause of the end; None before.
        finished: Whether the manoeuvre is complete.
    """

    def __init__(self, what: str, world: World, ego: int = 0) -> None:
        """Begins an episode.

        Args:
            what: A `Manoeuvre`, or "drive".
            world: At the first tick.
            ego: Index of the ego.
        """
        self.end: End | None = None
        self.finished = False
        self._what, self._ego, self._criteria = what, ego, criteria_of(what)
        self._stood_s, self._held_s = 0.0, 0.0
        self._resumed_from = math.nan
        for criterion in self._criteria:
            criterion.start(world, ego)

    def update(self, before: World, after: World, lateral: float, held: bool, arrived: bool, out: bool) -> End | None:
        """Updates by one tick.

        Args:
            before: The world before the tick.
            after: The world after it.
            lateral: Distance to the path that is followed, m.
            held: Whether a stop is lawful here.
            arrived: Whether a lane change has led into its lane.
            out: Whether the time or the route is over.
        """
        speed = float(after.egos.speed[self._ego])
        found = [one for criterion in self._criteria for one in criterion.update(before, after, self._ego)]
        self._stood_s = self._stood_s + TICK_S if speed < STANDING_M_S and not held else 0.0
        self._held_s = self._held_s + TICK_S if arrived else 0.0
        self.finished = self.finished or self._is_finished(after)
        if found or abs(lateral) > FARTHEST_M:
            self.end = End.INFRACTION
        elif self._stood_s > STANDING_S - TICK_S / 2:
            self.end = End.STANDING
        elif self.finished:
            self.end = End.DONE
        elif out:
            self.end = End.TIME
        return self.end

    def _is_finished(self, world: World) -> bool:
        progress = float(world.egos.progress[self._ego])
        if self._what in CHANGES:
            # Into the lane, and some way along it, since driving after the change counts too.
            return self._held_s > HOLD_S - TICK_S / 2
        if self._what == Manoeuvre.LIGHTS:
            lit = next(one for one in world.routes[self._ego].passages if one.signal >= 0)
            return progress > lit.exit + LEFT_JUNCTION_M
        if self._what == Manoeuvre.BRAKING and world.events and over(world):
            self._resumed_from = progress if math.isnan(self._resumed_from) else self._resumed_from
            return progress > self._resumed_from + RESUMED_M
        return False


def over(world: World) -> bool:
    """Whether all events of the scenario have happened."""
    return all(event.phase in (EventPhase.DONE, EventPhase.TIMED_OUT) for event in world.events)
