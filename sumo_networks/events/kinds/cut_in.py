"""Cut-ins: a vehicle beside the ego's lane moves into it, close ahead of the ego."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from dohyo.sumo_networks.actors.scripted_actor import ACCELERATION_MPS2, VEHICLES, ScriptedActor
from dohyo.sumo_networks.events.behavior import EventBehavior, EventContext, EventSite, PlacementError
from dohyo.sumo_networks.events.event import BaseEvent, Metres, Seconds, Side, Speed, VehicleType
from dohyo.sumo_networks.events.roads import need_clear_road, need_kerb, section

ROOM_M = 35.0
SLOW_SHARE = 0.5
HOLD_S = 6.0
SETTLE_S = 3.0
CLOSING_SHARE = 0.3
ROOM_S = 6.0
QUEUE_GAP_M = 2.5


class CutInBehavior(EventBehavior["CutInEvent"]):
    """The vehicle stands in the adjacent lane, moves into the ego's lane, and drives on ahead of the ego.

    Attributes:
        place: Arc length on the ego's route at which the vehicle stands or enters, m.
    """

    def __init__(self, event: CutInEvent, site: EventSite) -> None:
        super().__init__(event, site)
        self.place = site.trigger + event.ahead_m
        self._began, self._in = math.inf, math.inf
        self.check_road()
        self._sign = 1.0 if event.side == "left" else -1.0
        kind, length, width = VEHICLES[event.actor]
        self._beside = self._sign * self.distance_beside(width)
        self.actors.append(ScriptedActor(self.actor_name(0), kind, length, width, self.path, self.place, self._beside))

    def check_road(self) -> None:
        """Raises PlacementError if a junction is too near."""
        need_clear_road(self.route, self.place - 15.0, self.place + ROOM_M)

    def distance_beside(self, width: float) -> float:
        """Distance from the middle of the ego's lane to the middle of a vehicle in the adjacent lane, m.

        Raises:
            PlacementError: There is no such lane.
        """
        found = section(self.network, self.route, self.place)
        beside = found.left if self.event.side == "left" else found.right
        if beside < 0:
            raise PlacementError(f"at {self.place:.0f} m there is no lane to the {self.event.side}")
        return found.half_width + 0.5 * float(self.network.lanes.width[beside])

    def act(self, context: EventContext) -> bool:
        """Waits, then moves in; ends when the vehicle is in the lane and the ego has passed it or 6 s are over."""
        one = self.actors[0]
        if self._began == math.inf:
            if not self.is_due(context):
                self.wait(context)
                return False
            self._began = context.time
        self._move_in(one, context)
        return context.time - self._in >= HOLD_S or one.s + one.length < context.front_m

    def is_due(self, context: EventContext) -> bool:
        """Whether it is time to move in."""
        one, event = self.actors[0], self.event
        rear = one.s - 0.5 * one.length
        return context.time_to(rear) <= event.reaction_time_s or context.distance_to(rear) <= event.minimum_distance_m

    def wait(self, context: EventContext) -> None:
        """Advances one tick before it is time to move in."""

    def follow(self, one: ScriptedActor, desired: float, context: EventContext) -> None:
        """Drives at a desired speed [m/s], and keeps its distance to others ahead."""
        self.drive(one, desired, context)

    def _move_in(self, one: ScriptedActor, context: EventContext) -> None:
        pace = abs(self._beside) / self.event.merge_s
        target = self.event.speed_mps or SLOW_SHARE * context.speed
        if one.left * self._sign <= pace * context.tick_s:
            one.left, one.drift = 0.0, 0.0
            self._in = min(self._in, context.time)
        else:
            one.drift = -self._sign * pace
        if one.speed > target:
            one.speed = max(one.speed - 2 * ACCELERATION_MPS2 * context.tick_s, target)
        else:
            self.follow(one, target, context)

    def after(self, context: EventContext) -> None:
        """Drives the vehicle on along the ego's route."""
        one = self.actors[0]
        if one.left:
            self._move_in(one, context)
        else:
            limit = float(self.route.speed_limit[self.route.index(one.s)])
            self.drive(one, limit, context, lawful=True)

    def ahead(self, context: EventContext) -> float:
        """Distance to the vehicle that cuts in, m."""
        return self.actors[0].s - context.egos.progress.item(context.ego)


class CutInEvent(BaseEvent):
    """A vehicle beside the ego's lane moves into it, close ahead of the ego.

    Attributes:
        ahead_m: Distance from the trigger to the place at which the vehicle stands or enters, m.
        side: Side from which the vehicle comes.
        actor: Type of the vehicle.
        speed_mps: Speed after the cut-in, m/s; None: half of the ego's speed.
        reaction_time_s: The vehicle pulls out when the ego is nearer than this in time, s,
        minimum_distance_m: or nearer than this distance, m.
        merge_s: Time from the vehicle's place to the middle of the ego's lane, s.
    """

    behavior: ClassVar = CutInBehavior

    ahead_m: Metres = 50.0
    side: Side = "right"
    actor: VehicleType = "car"
    speed_mps: Speed | None = None
    reaction_time_s: Seconds = 2.35
    minimum_distance_m: Metres = 10.0
    merge_s: Annotated[float, Field(gt=0, le=20)] = 2.0


class ParkingCutInBehavior(CutInBehavior):
    """The vehicle is parked at the kerb."""

    def distance_beside(self, width: float) -> float:
        """Distance from the middle of the ego's lane to the middle of a vehicle at the kerb, m.

        Raises:
            PlacementError: Another lane lies between the ego's lane and the kerb.
        """
        event, found = self.event, need_kerb(self.network, self.route, self.place)
        if (found.right if event.side == "right" else found.left) >= 0 or (
            event.side == "left" and found.oncoming >= 0
        ):
            raise PlacementError(
                f"at {self.place:.0f} m another lane lies between the ego's lane and the {event.side} kerb"
            )
        return (found.kerb_right if event.side == "right" else found.kerb_left) + 0.5 * width + 0.1


class ParkingCutIn(CutInEvent):
    """A parked vehicle pulls out."""

    behavior: ClassVar = ParkingCutInBehavior
    kind: Literal["parking_cut_in"] = "parking_cut_in"
    speed_mps: Speed | None = 3.0


class StaticCutInBehavior(CutInBehavior):
    """The vehicle leaves a standing queue in the adjacent lane; the queue stays."""

    def __init__(self, event: CutInEvent, site: EventSite) -> None:
        super().__init__(event, site)
        kind, length, width = VEHICLES[event.actor]
        front = self.place + length + QUEUE_GAP_M
        self.actors.append(ScriptedActor(self.actor_name(1), kind, length, width, self.path, front, self._beside))

    def follow(self, one: ScriptedActor, desired: float, context: EventContext) -> None:
        """Drives at a desired speed [m/s]; the queue in the lane that it leaves does not stop it."""
        if one.drift:
            one.approach(desired, context.tick_s)
        else:
            super().follow(one, desired, context)


class StaticCutIn(CutInEvent):
    """One vehicle of a queue in the adjacent lane pulls out."""

    behavior: ClassVar = StaticCutInBehavior
    kind: Literal["static_cut_in"] = "static_cut_in"
    speed_mps: Speed | None = 3.0
    reaction_time_s: Seconds = 2.7
    minimum_distance_m: Metres = 15.0


class HighwayCutInBehavior(CutInBehavior):
    """The vehicle drives in the adjacent lane, lets the ego come near, and moves in."""

    def check_road(self) -> None:
        """Raises PlacementError if the vehicle cannot move in before the next junction."""
        limit = float(self.route.speed_limit[self.route.index(self.trigger)])
        need_clear_road(self.route, self.trigger, self.place + ROOM_S * limit, through=True)

    def prepare(self, context: EventContext) -> None:
        """Does nothing: the vehicle enters at the trigger."""

    def act(self, context: EventContext) -> bool:
        """Lets the vehicle enter, and then continues as every cut-in."""
        if not self.actors[0].present:
            self._enter(context)
        return super().act(context)

    def is_due(self, context: EventContext) -> bool:
        """Whether the ego is near enough."""
        one = self.actors[0]
        return one.s - 0.5 * one.length - context.front_m <= self._wanted_gap(context) + 1.0

    def wait(self, context: EventContext) -> None:
        """Drives a little slower than the ego."""
        one = self.actors[0]
        gap = one.s - 0.5 * one.length - context.front_m - self._wanted_gap(context)
        closing = max(gap / SETTLE_S, CLOSING_SHARE * context.speed)
        self.follow(one, max(context.speed - closing, 0.0), context)

    def _enter(self, context: EventContext) -> None:
        one = self.actors[0]
        one.s, one.speed = context.egos.progress.item(context.ego) + self.event.ahead_m, context.speed
        one.pose()
        super().prepare(context)

    def _wanted_gap(self, context: EventContext) -> float:
        """Gap at which the vehicle moves in, m."""
        return max(self.event.minimum_distance_m, 0.5 * self.event.reaction_time_s * context.speed)


class HighwayCutIn(CutInEvent):
    """A vehicle in the adjacent lane moves in, and slows down to half the ego's speed."""

    behavior: ClassVar = HighwayCutInBehavior
    kind: Literal["highway_cut_in"] = "highway_cut_in"
    side: Side = "left"
    reaction_time_s: Seconds = 2.0
    minimum_distance_m: Metres = 15.0
