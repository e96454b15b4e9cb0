"""Oncoming vehicles that come into the ego's lane."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from dohyo.sumo_networks.actors.paths import ActorPath
from dohyo.sumo_networks.actors.requests import ClearArea
from dohyo.sumo_networks.actors.scripted_actor import VEHICLES, ScriptedActor
from dohyo.sumo_networks.events.behavior import EventBehavior, EventContext, EventSite, PlacementError
from dohyo.sumo_networks.events.event import BaseEvent, Metres, Seconds, Speed, VehicleType
from dohyo.sumo_networks.events.roads import need_clear_road, section

CHANGE_S = 1.2
ENTERS_M = 10.0
"""Least distance of the ego at which a vehicle enters, m."""


class OncomingBehavior(EventBehavior["OncomingEvent"]):
    """Oncoming vehicles leave their lane before they meet the ego, and return to it.

    The vehicles' path is the ego's route backwards, so left of the path is the ego's right. They enter one after
    the other where it begins; what lies beyond is another road.
    """

    def __init__(self, event: OncomingEvent, site: EventSite) -> None:
        super().__init__(event, site)
        network, route, trigger = site.network, site.route, site.trigger
        far = trigger + event.appear_m
        need_clear_road(route, trigger, far, through=True)
        found = section(network, route, trigger + 0.5 * event.appear_m)
        if found.oncoming < 0 or section(network, route, far).oncoming < 0:
            raise PlacementError(f"there is no oncoming lane between {trigger:.0f} and {far:.0f} m")
        if found.left >= 0:
            raise PlacementError(
                f"at {trigger:.0f} m a lane of the same direction lies between the ego's lane and the oncoming lane"
            )
        kind, length, width = VEHICLES[event.actor]
        self._own = -(found.middle + 0.5 * float(network.lanes.width[found.oncoming]))
        self._over = 0.0 if event.intrusion_m is None else -(found.middle - event.intrusion_m + 0.5 * width)
        back = ActorPath(self.path.points[: route.index(far) + 1][::-1])
        self._length = back.length
        self.actors += [
            ScriptedActor(self.actor_name(n), kind, length, width, back, -n * event.spacing_m, self._own)
            for n in range(event.count)
        ]
        self._since: dict[str, float] = {}

    def prepare(self, context: EventContext) -> None:
        """Does nothing: the vehicles enter at the trigger."""

    def act(self, context: EventContext) -> bool:
        """Lets the vehicles approach, move over and move back; ends when all are past the ego."""
        for actor in self.actors:
            if actor.present:
                self._steer(actor, context)
            elif actor.s <= 0.0:
                self._approach(actor, context)
        own = self._length - (context.front_m - context.egos.length.item(context.ego))
        drives = (actor for actor in self.actors if actor.present or actor.s <= 0.0)
        return all(actor.s - 0.5 * actor.length > own + 5.0 for actor in drives)

    def _approach(self, actor: ScriptedActor, context: EventContext) -> None:
        """Lets a vehicle enter once it is where its path begins, unless the ego is there already."""
        if actor.s < 0.0:
            actor.s = min(actor.s + self.event.speed_mps * context.tick_s, 0.0)
            actor.pose()
        if actor.s == 0.0 and context.front_m < self._length - ENTERS_M:
            context.requests.append(ClearArea(actor.x, actor.y, 0.5 * actor.length + 3.0))
            actor.present = True

    def _steer(self, actor: ScriptedActor, context: EventContext) -> None:
        event = self.event
        gap = self._length - actor.s - 0.5 * actor.length - context.front_m
        closing = event.speed_mps + context.speed
        past = gap < -context.egos.length.item(context.ego) - actor.length
        if not past and gap / closing <= event.reaction_time_s:
            self._since.setdefault(actor.name, context.time)
        began = self._since.get(actor.name, math.inf)
        over = began < math.inf and context.time - began < event.return_s and not past
        self._shift(actor, self._over if over else self._own, context.tick_s)
        actor.speed = event.speed_mps
        if actor.s > self._length:
            actor.present = False

    def _shift(self, actor: ScriptedActor, target: float, seconds: float) -> None:
        pace = abs(self._own - self._over) / CHANGE_S
        remaining = target - actor.left
        if abs(remaining) <= pace * seconds:
            actor.left, actor.drift = target, 0.0
        else:
            actor.drift = math.copysign(pace, remaining)

    def after(self, context: EventContext) -> None:
        """Drives the vehicles on in their own lane to the start of the ego's route."""
        for actor in self.actors:
            self._shift(actor, self._own, context.tick_s)
            gap, speed = actor.leader(*context.others(actor))
            actor.approach(self.event.speed_mps, context.tick_s, gap, speed)
            if actor.s > self._length:
                actor.present = False

    def ahead(self, context: EventContext) -> float:
        """Distance to the first vehicle, m."""
        return self._length - self.actors[0].s - context.egos.progress.item(context.ego)


class OncomingEvent(BaseEvent):
    """An oncoming vehicle drives partly or wholly in the ego's lane, and returns to its own.

    Attributes:
        appear_m: Distance ahead of the trigger at which the first vehicle enters, m.
        actor: Type of the vehicles.
        count: Number of vehicles, one after the other.
        spacing_m: Distance between two vehicles, m.
        speed_mps: Speed of each vehicle, m/s.
        reaction_time_s: Time before the meeting with the ego at which a vehicle leaves its lane, s.
        return_s: Time after which the vehicle begins to return to its lane, s.
        intrusion_m: Distance of the vehicle's side past the road middle, m; None: all of it is in the ego's lane.
    """

    behavior: ClassVar = OncomingBehavior

    appear_m: Metres = 100.0
    actor: VehicleType = "car"
    count: Annotated[int, Field(ge=1, le=20)] = 1
    spacing_m: Annotated[float, Field(ge=2, le=200)] = 20.0
    speed_mps: Speed = 8.0
    reaction_time_s: Seconds = 4.0
    return_s: Seconds = 4.5
    intrusion_m: Metres | None = None


class OncomingInLane(OncomingEvent):
    """One vehicle drives in the ego's lane for a while."""

    kind: Literal["oncoming_in_lane"] = "oncoming_in_lane"


class InvadingTurn(OncomingEvent):
    """Three oncoming vehicles drive partly in the ego's lane until they have passed the ego."""

    kind: Literal["invading_turn"] = "invading_turn"
    count: Annotated[int, Field(ge=1, le=20)] = 3
    reaction_time_s: Seconds = 6.0
    return_s: Seconds = 60.0
    intrusion_m: Metres | None = 0.9
