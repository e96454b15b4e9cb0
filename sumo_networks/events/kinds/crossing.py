"""Crossing actors: one or more pedestrians or bicycles cross the ego's lane from the side, hidden or visible."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from dohyo.sumo_networks.actors.paths import ActorPath
from dohyo.sumo_networks.actors.scripted_actor import VEHICLES, ScriptedActor
from dohyo.sumo_networks.events.behavior import EventBehavior, EventContext, EventSite, PlacementError
from dohyo.sumo_networks.events.event import BaseEvent, Metres, Seconds, Side, Size, Speed
from dohyo.sumo_networks.events.roads import Section, crossing_after, need_kerb, next_passage, turns
from dohyo.sumo_networks.world import ActorKind

KERB_M = 0.6
PATIENCE_M = 1.0
STANDING_MPS = 0.5


class CrossingBehavior(EventBehavior["CrossingEvent"]):
    """The actors wait at the kerb; the first is timed to meet the front of an ego that keeps its speed.

    They start at the distance that they cover within the reaction time, or at the kerb if that is farther away; in the
    second case they start earlier. No actor walks into a standing ego.

    Attributes:
        line: Arc length on the ego's route at which the actors cross, m.
        run_up: Distance from the start of the actors to the middle of the ego's lane, m.
    """

    def __init__(self, event: CrossingEvent, site: EventSite) -> None:
        super().__init__(event, site)
        self.line, section = event.find_line(site)
        sign = 1.0 if event.side == "left" else -1.0
        near, far = section.kerb_right, section.kerb_left
        if event.side == "left":
            near, far = far, near
        self.run_up = max(near + KERB_M, event.reaction_time_s * event.speed_mps)
        self._reach = self.run_up + far + KERB_M + 1.0
        self._started = math.inf
        self._paused: dict[str, float] = {}
        kind = ActorKind.PEDESTRIAN if event.actor == "pedestrian" else ActorKind.BICYCLE
        for number in range(event.count):
            along, behind = (
                (0.0, number * event.spacing_m) if event.actor == "bicycle" else (number * event.spacing_m, 0.0)
            )
            way = self._way(self.line + along, sign)
            name = self.actor_name(number)
            self.actors.append(ScriptedActor(name, kind, event.length_m, event.width_m, way, -behind, across=True))
        self._hide_behind(sign, near)

    def _way(self, line: float, sign: float) -> ActorPath:
        start, end = self.path.at(line, sign * self.run_up), self.path.at(line, sign * (self.run_up - self._reach))
        return ActorPath(np.array([start[:2], end[:2]]))

    def _hide_behind(self, sign: float, kerb: float) -> None:
        if self.event.occluder == "none":
            return
        parked = self.event.occluder == "parked_car"
        kind, length, width = VEHICLES["car"] if parked else (ActorKind.STATIC, 1.6, 1.0)
        before, beside = self.line - 0.5 * length - 0.8, kerb + 0.5 * width + (0.1 if parked else 0.3)
        name = self.actor_name(self.event.count)
        self.actors.append(ScriptedActor(name, kind, length, width, self.path, before, sign * beside))

    @property
    def walkers(self) -> list[ScriptedActor]:
        """The crossing actors, without the object that hides them."""
        return self.actors[: self.event.count]

    def act(self, context: EventContext) -> bool:
        """Starts the actors when it is time, and moves them to the other side."""
        if self._started == math.inf and self._due(context):
            self._started = context.time
        if self._started < math.inf:
            for walker in self.walkers:
                self._walk(walker, context)
        return all(walker.s >= self._reach for walker in self.walkers)

    def _due(self, context: EventContext) -> bool:
        event, distance = self.event, context.distance_to(self.line)
        return distance <= event.minimum_distance_m or context.time_to(self.line) <= self.run_up / event.speed_mps

    def _walk(self, walker: ScriptedActor, context: EventContext) -> None:
        paused = self._paused.get(walker.name, 0.0)
        waits = walker.s >= self.run_up and paused < self.event.pause_s
        if waits:
            self._paused[walker.name] = paused + context.tick_s
        if waits or walker.s >= self._reach or _runs_into_standing_ego(walker, context):
            walker.speed = 0.0
        else:
            walker.speed = self.event.speed_mps

    def after(self, context: EventContext) -> None:
        """Moves the actors on that are not across yet."""
        for walker in self.walkers:
            if self._started < math.inf:
                self._walk(walker, context)


def _runs_into_standing_ego(walker: ScriptedActor, context: EventContext) -> bool:
    from dohyo.sumo_networks.geometry import boxes_overlap  # late import: scenarios are read without compiled kernels

    x, y, heading, length, width = walker.box
    half = 0.5 * PATIENCE_M
    ahead = np.array(
        [[x + half * math.cos(heading), y + half * math.sin(heading), heading, length + PATIENCE_M, width + 0.4]]
    )
    for ego in np.flatnonzero(context.egos.active):
        standing = context.egos.speed[ego] < STANDING_MPS
        if standing and boxes_overlap(ahead, context.egos.box(int(ego))[None])[0, 0]:
            return True
    return False


class CrossingEvent(BaseEvent):
    """Actors cross the ego's lane from the side, timed to meet its front if the ego keeps its speed.

    Attributes:
        ahead_m: Distance from the trigger to the line of crossing, m; unused if the line lies behind a junction.
        side: Side from which the actors come.
        actor: Type of the actors.
        count: Number of actors.
        spacing_m: Distance between two actors, m.
        speed_mps: Speed of crossing, m/s.
        reaction_time_s: The actors start at the latest when the ego is nearer to the line than this in time, s,
        minimum_distance_m: or nearer than this distance, m.
        length_m: Length of each actor, m.
        width_m: Width of each actor, m.
        occluder: Type of the object that hides the actors; None: no object.
        pause_s: Time for which the actors stand in the ego's lane, s.
    """

    behavior: ClassVar = CrossingBehavior

    ahead_m: Metres = 40.0
    side: Side = "right"
    actor: Literal["pedestrian", "bicycle"] = "pedestrian"
    count: Annotated[int, Field(ge=1, le=50)] = 1
    spacing_m: Metres = 1.0
    speed_mps: Speed = 2.0
    reaction_time_s: Seconds = 2.1
    minimum_distance_m: Metres = 6.0
    length_m: Size = 0.5
    width_m: Size = 0.5
    occluder: Literal["none", "kiosk", "parked_car"] = "none"
    pause_s: Seconds = 0.0

    def find_line(self, site: EventSite) -> tuple[float, Section]:
        """Arc length on the ego's route at which the actors cross, m, and the road's cross-section there.

        Raises:
            PlacementError: The actors cannot cross there.
        """
        line = site.trigger + self.ahead_m
        found = need_kerb(site.network, site.route, line)
        if line + 5.0 > site.route.length:
            raise PlacementError(f"the route ends at {site.route.length:.0f} m")
        return line, found


class BehindJunctionEvent(CrossingEvent):
    """Actors cross behind the next junction.

    Attributes:
        turn: Whether the route must turn at the junction.
    """

    turn: ClassVar[bool] = False

    def find_line(self, site: EventSite) -> tuple[float, Section]:
        """Arc length on the ego's route at which the actors cross, m, and the road's cross-section there.

        Raises:
            PlacementError: The route has no such junction.
        """
        network, route = site.network, site.route
        passage = next_passage(network, route, site.trigger)
        if self.turn and not turns(passage):
            raise PlacementError(f"the route goes straight on at the junction at {passage.entry:.0f} m")
        return crossing_after(network, route, passage), need_kerb(network, route, passage.exit + 1.0)


class DynamicObjectCrossing(CrossingEvent):
    """A pedestrian, hidden by a kiosk, crosses."""

    kind: Literal["dynamic_object_crossing"] = "dynamic_object_crossing"
    occluder: Literal["none", "kiosk", "parked_car"] = "kiosk"


class ParkingCrossingPedestrian(CrossingEvent):
    """A pedestrian, hidden by a parked car, crosses."""

    kind: Literal["parking_crossing_pedestrian"] = "parking_crossing_pedestrian"
    reaction_time_s: Seconds = 2.15
    occluder: Literal["none", "kiosk", "parked_car"] = "parked_car"


class PedestrianGroupCrossing(BehindJunctionEvent):
    """Three pedestrians cross side by side."""

    kind: Literal["pedestrian_group_crossing"] = "pedestrian_group_crossing"
    count: Annotated[int, Field(ge=1, le=50)] = 3
    speed_mps: Speed = 1.3
    reaction_time_s: Seconds = 3.5
    minimum_distance_m: Metres = 12.0


class CyclistAfterTurn(BehindJunctionEvent):
    """A bicycle crosses behind a junction where the ego turns."""

    turn: ClassVar[bool] = True
    kind: Literal["cyclist_after_turn"] = "cyclist_after_turn"
    actor: Literal["pedestrian", "bicycle"] = "bicycle"
    speed_mps: Speed = 1.8
    reaction_time_s: Seconds = 1.8
    length_m: Size = 1.7
    width_m: Size = 0.65


class PedestrianAfterTurn(BehindJunctionEvent):
    """A pedestrian crosses behind a junction where the ego turns."""

    turn: ClassVar[bool] = True
    kind: Literal["pedestrian_after_turn"] = "pedestrian_after_turn"
    speed_mps: Speed = 1.8
    reaction_time_s: Seconds = 2.2


class CrossingBicycleFlow(BehindJunctionEvent):
    """Five bicycles cross one after the other."""

    kind: Literal["crossing_bicycle_flow"] = "crossing_bicycle_flow"
    actor: Literal["pedestrian", "bicycle"] = "bicycle"
    count: Annotated[int, Field(ge=1, le=50)] = 5
    spacing_m: Metres = 12.0
    speed_mps: Speed = 4.0
    reaction_time_s: Seconds = 3.0
    minimum_distance_m: Metres = 12.0
    length_m: Size = 1.7
    width_m: Size = 0.65


class PedestrianStepsOut(CrossingEvent):
    """A pedestrian stands in the ego's lane for a time."""

    kind: Literal["pedestrian_steps_out"] = "pedestrian_steps_out"
    ahead_m: Metres = 30.0
    speed_mps: Speed = 1.5
    minimum_distance_m: Metres = 30.0
    pause_s: Seconds = 6.0
