"""Cross traffic: a vehicle enters the ego's junction although it must wait."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

from dohyo.sumo_networks.actors.scripted_actor import VEHICLES, ScriptedActor
from dohyo.sumo_networks.events.behavior import EventBehavior, EventContext, EventSite, PlacementError
from dohyo.sumo_networks.events.event import BaseEvent, Metres, Seconds, Speed, VehicleType
from dohyo.sumo_networks.events.roads import ConflictingWay, conflicting_ways, next_passage
from dohyo.sumo_networks.units import KMH_PER_MPS

CATCH_UP = 1.5
BEND_M_S2 = 4.0
"""Lateral acceleration of a hasty driver in a bend, m/s^2."""
BEND_REACH_M = 20.0
STRAIGHT, INDICATOR = "s", {"l": 1, "L": 1, "r": -1, "R": -1}


class CrossTrafficBehavior(EventBehavior["CrossTrafficEvent"]):
    """The vehicle approaches in time with the ego, such that both meet; near the meeting point it does not stop.

    Attributes:
        way: Path of the vehicle through the junction.
        meeting: Arc length on the ego's route at which the ego's front meets the middle of that path, m.
        speed: Speed of the vehicle, m/s: the event's speed, or less in a turn.
    """

    def __init__(self, event: CrossTrafficEvent, site: EventSite) -> None:
        super().__init__(event, site)
        network, route = site.network, site.route
        self._going = False
        passage = next_passage(network, route, site.trigger)
        lit = passage.signal >= 0
        if lit != event.lit:
            raise PlacementError(f"the junction at {passage.entry:.0f} m has {'a' if lit else 'no'} traffic light")
        self.way, self.speed = self._find_way(
            conflicting_ways(network, route, passage, 2.0 * self._run_up(event.speed_mps))
        )
        self.meeting = self.way.own_s
        self._set_off = self._run_up(self.speed)
        kind, length, width = VEHICLES[event.actor]
        self._start = max(self.way.path_s - 2.0 * self._set_off, 0.5 * length)
        actor = ScriptedActor(self.actor_name(0), kind, length, width, self.way.path, self._start)
        actor.indicator = INDICATOR.get(self._direction(self.way), 0)
        self.actors.append(actor)

    def _find_way(self, found: list[ConflictingWay]) -> tuple[ConflictingWay, float]:
        """Path with the longest approach, preferably straight on, and the speed [m/s] on it."""
        wanted = ("left", "right", "opposite") if self.event.comes_from == "any" else (self.event.comes_from,)
        for way in sorted(found, key=lambda way: self._direction(way) != STRAIGHT):
            speed = self._speed_on(way)
            if way.side in wanted and way.path_s >= self._run_up(speed) + 0.5 * VEHICLES[self.event.actor][1]:
                return way, speed
        raise PlacementError(
            f"no path through the next junction from {' or '.join(wanted)} meets the ego's path after an approach of "
            f"{self._run_up(self.event.speed_mps):.0f} m"
        )

    def _direction(self, way: ConflictingWay) -> str:
        return str(self.network.connections.direction[way.connection])

    def _speed_on(self, way: ConflictingWay) -> float:
        """Speed of the event, or, on a path that turns, of the sharpest bend around the meeting point, m/s."""
        if self._direction(way) == STRAIGHT:
            return self.event.speed_mps
        sharpest = way.path.curvature(way.path_s - BEND_REACH_M, way.path_s + BEND_REACH_M)
        return min(self.event.speed_mps, math.sqrt(BEND_M_S2 / max(sharpest, 1e-6)))

    def _run_up(self, speed: float) -> float:
        """Distance covered at a speed [m/s] within the reaction time, m."""
        return speed * self.event.reaction_time_s

    def prepare(self, context: EventContext) -> None:
        """Does nothing: the vehicle enters later, in time to meet the ego."""

    def act(self, context: EventContext) -> bool:
        """Drives the vehicle; ends when the vehicle or the ego is through the junction."""
        vehicle, speed = self.actors[0], self.speed
        remaining, wait = self.way.path_s - vehicle.s, context.time_to(self.meeting)
        if not vehicle.present:
            if wait * speed <= self.way.path_s - self._start or self._near(context):
                super().prepare(context)
            return context.distance_to(self.meeting) < -20.0
        self._going = self._going or self._near(context)
        if self._going:
            vehicle.speed = speed
        else:
            behind = remaining - speed * wait
            vehicle.speed = min(max(behind / context.tick_s, 0.0), CATCH_UP * speed)
            vehicle.speed = min(vehicle.speed, max(remaining - self._set_off, 0.0) / context.tick_s)
        return remaining < -20.0 or vehicle.s > vehicle.path.length - vehicle.length

    def _near(self, context: EventContext) -> bool:
        event = self.event
        return (
            context.time_to(self.meeting) <= event.reaction_time_s
            or context.distance_to(self.meeting) <= event.minimum_distance_m
        )

    def after(self, context: EventContext) -> None:
        """Drives the vehicle on to the end of its path."""
        vehicle = self.actors[0]
        vehicle.indicator = 0
        gap, speed = vehicle.leader(*context.others(vehicle))
        vehicle.approach(self.event.speed_mps, context.tick_s, gap, speed)


class CrossTrafficEvent(BaseEvent):
    """A vehicle enters the ego's junction against the rules, timed to collide if the ego keeps its speed.

    Attributes:
        lit: Whether the junction has a traffic light.
        comes_from: Side from which the vehicle comes, seen from the ego.
        actor: Type of the vehicle.
        speed_mps: Speed of the vehicle, m/s.
        reaction_time_s: The vehicle adapts to the ego until the ego is nearer to the meeting point than this in time,
            s,
        minimum_distance_m: or nearer than this distance, m.
    """

    behavior: ClassVar = CrossTrafficBehavior
    lit: ClassVar[bool]

    comes_from: Literal["any", "left", "right", "opposite"] = "any"
    actor: VehicleType = "car"
    speed_mps: Speed = 60 / KMH_PER_MPS
    reaction_time_s: Seconds = 2.2
    minimum_distance_m: Metres = 12.0


class OppositeRunsRedLight(CrossTrafficEvent):
    """The vehicle runs a red light."""

    lit: ClassVar[bool] = True
    kind: Literal["opposite_runs_red_light"] = "opposite_runs_red_light"


class OppositeTakesPriority(CrossTrafficEvent):
    """The vehicle takes the right of way at a junction without a light."""

    lit: ClassVar[bool] = False
    kind: Literal["opposite_takes_priority"] = "opposite_takes_priority"
