"""Leads: a vehicle ahead of the ego, in its lane, brakes hard, stands, and drives on."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from dohyo.sumo_networks.actors.requests import ClearArea
from dohyo.sumo_networks.actors.scripted_actor import VEHICLES, ScriptedActor
from dohyo.sumo_networks.events.behavior import EventBehavior, EventContext, EventSite
from dohyo.sumo_networks.events.event import BaseEvent, Metres, Seconds, VehicleType
from dohyo.sumo_networks.events.roads import need_clear_road

SETTLE_S = 3.0
CLOSING_SHARE = 0.3
BRAKING_ROOM_S = 4.0


class LeadBehavior(EventBehavior["LeadEvent"]):
    """A vehicle enters ahead, waits until the ego is near, brakes, stands, and drives on."""

    def __init__(self, event: LeadEvent, site: EventSite) -> None:
        super().__init__(event, site)
        route, trigger = site.route, site.trigger
        limit = float(route.speed_limit[route.index(trigger)])
        need_clear_road(route, trigger, trigger + event.appear_m + BRAKING_ROOM_S * limit, through=True)
        self._came, self._braked = math.inf, math.inf
        kind, length, width = VEHICLES[event.actor]
        start = trigger + event.appear_m
        self.actors.append(ScriptedActor(self.actor_name(0), kind, length, width, self.path, start))

    def prepare(self, context: EventContext) -> None:
        """Does nothing: the vehicle enters at the trigger, at a speed that depends on the ego."""

    def act(self, context: EventContext) -> bool:
        """Lets the vehicle enter, wait for the ego and brake; ends when it may drive on."""
        lead, event = self.actors[0], self.event
        if not lead.present:
            self._enter(context)
        gap = lead.s - 0.5 * lead.length - context.front_m
        if self._braked == math.inf and (gap <= event.gap_m or context.time - self._came >= event.wait_s):
            self._braked = context.time
        if self._braked == math.inf:
            closing = max((gap - event.gap_m) / SETTLE_S, CLOSING_SHARE * context.speed)
            self.drive(lead, max(context.speed - closing, 0.0), context)
            return False
        lead.speed = max(lead.speed - event.deceleration_mps2 * context.tick_s, 0.0)
        return context.time - self._braked >= event.stop_s

    def _enter(self, context: EventContext) -> None:
        lead = self.actors[0]
        lead.s = context.egos.progress.item(context.ego) + self.event.appear_m
        lead.speed = context.speed
        lead.pose()
        super().prepare(context)
        x, y, _ = self.path.at(lead.s - 0.5 * self.event.appear_m)
        context.requests.append(ClearArea(x, y, max(0.5 * self.event.appear_m - 6.0, 0.0)))
        self._came = context.time

    def after(self, context: EventContext) -> None:
        """Drives the vehicle on along the ego's route; it stops at red lights."""
        lead = self.actors[0]
        limit = float(self.route.speed_limit[self.route.index(lead.s)])
        self.drive(lead, limit, context, lawful=True)

    def ahead(self, context: EventContext) -> float:
        """Distance to the lead vehicle, m."""
        return self.actors[0].s - context.egos.progress.item(context.ego)


class LeadEvent(BaseEvent):
    """A vehicle ahead of the ego, in its lane, brakes hard, stands, and drives on.

    Attributes:
        appear_m: Distance ahead of the ego at which the vehicle enters, between the centres, m.
        gap_m: The vehicle brakes when the ego's front is nearer to its rear than this, m,
        wait_s: or after this time, s.
        deceleration_mps2: Deceleration of the vehicle, m/s^2.
        stop_s: Time for which the vehicle brakes and stands, s.
        actor: Type of the vehicle.
    """

    behavior: ClassVar = LeadBehavior

    appear_m: Metres = 40.0
    gap_m: Metres = 12.0
    wait_s: Seconds = 8.0
    deceleration_mps2: Annotated[float, Field(gt=0, le=10)] = 8.0
    stop_s: Seconds = 10.0
    actor: VehicleType = "car"


class HardBrake(LeadEvent):
    """The vehicle ahead brakes as hard as it can."""

    kind: Literal["hard_brake"] = "hard_brake"


class LeadVehicleBrakes(LeadEvent):
    """The vehicle ahead brakes less hard, and stands for a shorter time."""

    kind: Literal["lead_vehicle_brakes"] = "lead_vehicle_brakes"
    deceleration_mps2: Annotated[float, Field(gt=0, le=10)] = 6.0
    stop_s: Seconds = 4.0
