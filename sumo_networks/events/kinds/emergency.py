"""Emergency: a vehicle with blue lights approaches from behind, and the ego must let it pass."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

import numpy as np

from dohyo.sumo_networks.actors.paths import ActorPath, lane_path, upstream
from dohyo.sumo_networks.actors.requests import ClearArea
from dohyo.sumo_networks.actors.scripted_actor import VEHICLES, ScriptedActor
from dohyo.sumo_networks.events.behavior import EventBehavior, EventContext, EventSite, PlacementError
from dohyo.sumo_networks.events.event import BaseEvent, Metres, Seconds, Speed
from dohyo.sumo_networks.events.roads import section

CLOSE_M = 25.0
PASSED_M = 5.0
AHEAD_M = 150.0
CLEARED_M = 12.0
TYPE = "emergency"


class EmergencyBehavior(EventBehavior["YieldToEmergencyVehicle"]):
    """The vehicle follows the ego's route at its own speed, through red lights, and never hits anything.

    The event ends when the vehicle's rear is 5 m ahead of the ego's front, or when the vehicle has been close behind
    for too long: the ego did not yield. The vehicle then drives on until no ego sees it.
    """

    prepare_m = 0.0

    def __init__(self, event: YieldToEmergencyVehicle, site: EventSite) -> None:
        super().__init__(event, site)
        network, route, trigger = site.network, site.route, site.trigger
        self._check_room()
        self._before = 0.0
        lanes = upstream(network, int(route.lane[0]), event.behind_m + float(network.lanes.length[route.lane[0]]))
        short = max(event.behind_m - trigger, 0.0)
        if short > 0.0:
            self._extend(lanes, short)
        kind, length, width = VEHICLES[TYPE]
        start = self._before + trigger - event.behind_m
        self.actors.append(ScriptedActor(self.actor_name(0), kind, length, width, self.path, start))
        self._close = math.inf

    def _check_room(self) -> None:
        if self.trigger + AHEAD_M > self.route.length:
            raise PlacementError(
                f"the route ends at {self.route.length:.0f} m, {self.trigger + AHEAD_M:.0f} m are needed"
            )
        for ahead in np.arange(self.trigger, self.trigger + AHEAD_M, 10.0):
            try:
                found = section(self.network, self.route, float(ahead))
            except PlacementError:
                continue
            if found.left < 0 and found.right < 0:
                raise PlacementError(f"at {ahead:.0f} m there is no second lane on which the vehicle can pass")

    def _extend(self, lanes: list[int], short: float) -> None:
        """Extends the path backwards beyond the route's start, on the lanes that lead there."""
        back = lane_path(self.network, lanes)
        s, _ = back.project(self.route.position[:1], 0.0, back.length)
        begin = float(s[0]) - short
        if begin < 0.0:
            raise PlacementError(f"only {float(s[0]) + self.trigger:.0f} m of road lie behind the trigger")
        rows = (back.arc >= begin) & (back.arc < float(s[0]) - 1.0)
        whole = ActorPath(np.concatenate([back.points[rows], self.route.position]))
        self._before, self.path = whole.length - self.path.length, whole

    def prepare(self, context: EventContext) -> None:
        """Does nothing: the vehicle enters behind the ego, after the trigger."""

    def act(self, context: EventContext) -> bool:
        """Drives the vehicle; ends when it has passed or has waited too long."""
        vehicle = self.actors[0]
        if not vehicle.present:
            vehicle.s = max(self._before + context.egos.progress.item(context.ego) - self.event.behind_m, 0.0)
            vehicle.speed = self.event.speed_mps
            vehicle.pose()
            super().prepare(context)
        self._hurry(context)
        behind = -self.ahead(context)
        if behind < CLOSE_M:
            self._close = min(self._close, context.time)
        reach = 0.5 * (vehicle.length + context.egos.length.item(context.ego))
        return behind < -(reach + PASSED_M) or context.time - self._close >= self.event.wait_s

    def _hurry(self, context: EventContext) -> None:
        vehicle = self.actors[0]
        # Vehicles that cannot make room, as before a red light, are removed, so that only the ego blocks it.
        nose = vehicle.s + 0.5 * vehicle.length + CLEARED_M
        if nose < self._before + context.egos.progress.item(context.ego) - CLEARED_M or not self._blocked(context):
            context.requests.append(ClearArea(*self.path.at(nose)[:2], 0.5 * CLEARED_M))
        self.drive(vehicle, self.event.speed_mps, context)

    def _blocked(self, context: EventContext) -> bool:
        """Whether the ego is ahead in the vehicle's way, and not beside it."""
        box, speed = context.egos.box(context.ego)[None], context.egos.speed[[context.ego]]
        return bool(context.egos.active[context.ego]) and self.actors[0].leader(box, speed)[0] < math.inf

    def after(self, context: EventContext) -> None:
        """Drives the vehicle on."""
        self._hurry(context)

    def ahead(self, context: EventContext) -> float:
        """Distance to the emergency vehicle, m."""
        return self.actors[0].s - self._before - context.egos.progress.item(context.ego)


class YieldToEmergencyVehicle(BaseEvent):
    """An emergency vehicle with blue lights approaches from behind; the ego must let it pass.

    Attributes:
        behind_m: Distance behind the ego at which the vehicle enters, m.
        speed_mps: Highest speed of the vehicle, m/s.
        wait_s: Longest time within 25 m behind the ego before the event ends without passing, s.
    """

    behavior: ClassVar = EmergencyBehavior

    kind: Literal["yield_to_emergency_vehicle"] = "yield_to_emergency_vehicle"
    behind_m: Metres = 140.0
    speed_mps: Speed = 20.0
    wait_s: Seconds = 20.0
