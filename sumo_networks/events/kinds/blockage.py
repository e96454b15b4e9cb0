"""Blockages: objects stand in the ego's lane, for a time or until the ego has passed them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from dohyo.sumo_networks.actors.scripted_actor import HARDEST_MPS2, VEHICLES, ScriptedActor
from dohyo.sumo_networks.events.behavior import IN_LANE_M, EventBehavior, EventContext, EventSite, PlacementError
from dohyo.sumo_networks.events.event import BaseEvent, Gaps, Metres, Seconds, Size, VehicleType
from dohyo.sumo_networks.events.roads import need_clear_road, need_kerb, next_passage, section
from dohyo.sumo_networks.events.vehicle_source import VehicleSource, side_flow
from dohyo.sumo_networks.world import ActorKind

PAST_M = 10.0
NEAR_M = 25.0
BEND_RAD = math.radians(30.0)
BEND_M = 30.0
DOOR_M = 1.0
SEEN_M, COMES_S = 60.0, 1.0
"""How far from a door others are looked at, m, and how long before one comes it stays closed, s."""
PASSING_M = 0.6
"""Distance of an open door from the middle of the ego's lane, m: less than half an ego's width."""


class BlockageBehavior(EventBehavior["BlockageEvent"]):
    """Boxes stand in the lane; some leave after a time. The event ends when the ego is past or they are gone.

    Attributes:
        place: Arc length of the first box's centre on the ego's route, m.
        source: Source of the vehicles in the adjacent lane; None: no vehicles there.
    """

    def __init__(self, event: BlockageEvent, site: EventSite) -> None:
        super().__init__(event, site)
        self.place = site.trigger + event.ahead_m
        self.source: VehicleSource | None = None
        self._stays_since = math.inf
        self.build()
        self.end = max(actor.s + 0.5 * actor.length for actor in self.actors)
        if self.end + PAST_M > self.route.length:
            raise PlacementError(f"the route ends at {self.route.length:.0f} m, {self.end + PAST_M:.0f} m are needed")

    def build(self) -> None:
        """Finds the place and adds the boxes.

        Raises:
            PlacementError: The boxes cannot stand there.
        """
        raise NotImplementedError

    def add_box(
        self, kind: ActorKind, length: float, width: float, s: float, left: float = 0.0, skew: float = 0.0
    ) -> ScriptedActor:
        """Adds a box [m] at a point of the ego's route, with an offset to the left [m] and an angle [rad]."""
        name = self.actor_name(len(self.actors))
        self.actors.append(ScriptedActor(name, kind, length, width, self.path, s, left, skew=skew))
        return self.actors[-1]

    def add_vehicle(self, s: float, left: float = 0.0) -> None:
        """Adds the event's vehicle at a point of the ego's route."""
        self.add_box(*self.vehicle_size, s, left=left)

    def add_side_flow(self, oncoming: bool) -> None:
        """Adds a flow in the lane to the left, if the event has one."""
        if self.event.gap_m is not None:
            self.source = side_flow(self.network, self.route, self.place, self.event.gap_m, oncoming=oncoming)

    @property
    def vehicle_size(self) -> tuple[ActorKind, float, float]:
        """Kind, length and width [m] of the event's vehicle."""
        kind, length, width = VEHICLES[self.event.actor]
        return kind, self.event.length_m or length, self.event.width_m or width

    @property
    def entered(self) -> Sequence[str]:
        """Names of the vehicles in the adjacent lane."""
        return self.source.entered if self.source is not None else ()

    def prepare(self, context: EventContext) -> None:
        """Adds the boxes before the ego sees their place."""
        super().prepare(context)
        self.emit(context)

    def emit(self, context: EventContext) -> None:
        """Lets the next vehicle enter the adjacent lane."""
        if self.source is not None:
            self.source.emit(self.event.name, context, self.rng)

    def await_trigger(self, context: EventContext) -> None:
        """Runs the flow in the adjacent lane."""
        self.emit(context)

    def act(self, context: EventContext) -> bool:
        """Keeps the boxes until the ego is past or their time is over."""
        self.emit(context)
        return context.distance_to(self.end) < -PAST_M - context.egos.length.item(context.ego) or self.leaves(context)

    def leaves(self, context: EventContext) -> bool:
        """Whether the blockage's time is over; call it in every tick."""
        if self.event.stay_s is None:
            return False
        if self.stay_counts(context):
            self._stays_since = min(self._stays_since, context.time)
        return context.time - self._stays_since >= self.event.stay_s

    def stay_counts(self, context: EventContext) -> bool:
        """Whether the stay has begun: by default, at the trigger."""
        return True

    def after(self, context: EventContext) -> None:
        """Drives a single vehicle on after its stay."""
        if self.event.stay_s is not None:
            limit = float(self.route.speed_limit[self.route.index(self.actors[0].s)])
            self.drive(self.actors[0], limit, context, lawful=True)

    def withdraw(self, context: EventContext) -> None:
        """Ends the flow."""
        if self.source is not None:
            self.source.stop(context)

    def ahead(self, context: EventContext) -> float:
        """Distance to the first box, m."""
        return self.actors[0].s - context.egos.progress.item(context.ego)


class BlockageEvent(BaseEvent):
    """An object stands in the ego's lane, for a time or until the ego has passed it.

    Attributes:
        ahead_m: Distance from the trigger to the object's centre, m; unused if a junction or a bend sets the place.
        actor: Type of the standing vehicle, if the object is one vehicle.
        length_m: Length of the standing vehicle, m; None: the type's length.
        width_m: Width of the standing vehicle, m; None: the type's width.
        stay_s: Time from the trigger to the departure, s (blocked_intersection: from the ego's arrival within 25 m or
            at the end of a queue); None: the object stays until the ego has passed.
        reaction_time_s: A door opens when the ego is nearer than this in time, s,
        minimum_distance_m: or nearer than this distance, m.
        gap_m: Smallest and largest gap, m, of the vehicles in the lane that the ego must use to pass; None: no
            vehicles.
    """

    ahead_m: Metres = 60.0
    actor: VehicleType = "car"
    length_m: Size | None = None
    width_m: Annotated[float, Field(gt=0, le=3)] | None = None
    stay_s: Seconds | None = None
    reaction_time_s: Seconds = 2.0
    minimum_distance_m: Metres = 10.0
    gap_m: Gaps | None = None


class OpeningDoorBehavior(BlockageBehavior):
    """A parked vehicle opens a door into the ego's lane."""

    def build(self) -> None:
        """Parks the vehicle at the kerb with its door closed."""
        found = need_kerb(self.network, self.route, self.place)
        need_clear_road(self.route, self.place - 15.0, self.place + 15.0)
        if found.right >= 0:
            raise PlacementError(f"at {self.place:.0f} m another lane lies between the ego's lane and the kerb")
        kind, length, width = self.vehicle_size
        side = PASSING_M + DOOR_M
        self.add_box(kind, length, width, self.place, left=-side - 0.5 * width)
        self._door = self.add_box(ActorKind.STATIC, 0.15, DOOR_M, self.place + 0.6, left=-side + 0.5 * DOOR_M)

    def prepare(self, context: EventContext) -> None:
        """Adds the vehicle before the ego sees its place; the door is closed."""
        super().prepare(context)
        self._door.present = False

    def act(self, context: EventContext) -> bool:
        """Opens the door when the ego is near, and nobody else is beside it; else as soon as he is, or not at all."""
        if not self._door.present:
            event, near = self.event, context.distance_to(self.place)
            comes = near <= event.minimum_distance_m or context.time_to(self.place) <= event.reaction_time_s
            can_stop = near > context.speed**2 / (2 * HARDEST_MPS2)
            self._door.present = comes and can_stop and not self._others_beside(context)
        return super().act(context)

    def _others_beside(self, context: EventContext) -> bool:
        """Whether a door would open into somebody else, in SUMO a standstill without end."""
        boxes, speeds, names = context.around
        own = {actor.name for actor in self.actors}
        ego = int(np.count_nonzero(context.egos.active[: context.ego]))
        others = [row for row, name in enumerate(names) if row != ego and name not in own]
        door, half = self._door.s, 0.5 * boxes[others, 3]
        along, left = self.path.project(boxes[others, :2], door - SEEN_M, door + SEEN_M)
        comes = (along < door) & (door - along < half + speeds[others] * COMES_S)
        leaves = (along >= door) & (along - door < half + DOOR_M)
        return bool(((comes | leaves) & (np.abs(left) < IN_LANE_M)).any())


class VehicleOpensDoor(BlockageEvent):
    """A parked car whose door opens."""

    behavior: ClassVar = OpeningDoorBehavior
    kind: Literal["vehicle_opens_door"] = "vehicle_opens_door"


class BlockedIntersectionBehavior(BlockageBehavior):
    """A vehicle stands just behind the next junction."""

    def build(self) -> None:
        """Puts the vehicle behind the junction."""
        passage = next_passage(self.network, self.route, self.trigger)
        self.place = passage.exit + 0.5 * self.vehicle_size[1] + 2.0
        self.add_vehicle(self.place)

    def await_trigger(self, context: EventContext) -> None:
        """Ends the blockage if a queue keeps the ego away from it."""
        super().await_trigger(context)
        if self.leaves(context):
            self.after(context)

    def stay_counts(self, context: EventContext) -> bool:
        """Whether the ego is near, or a queue keeps it away."""
        return context.distance_to(self.place) < NEAR_M or self.queues(context, self.place)


class BlockedIntersection(BlockageEvent):
    """A vehicle blocks the exit of the next junction."""

    behavior: ClassVar = BlockedIntersectionBehavior
    kind: Literal["blocked_intersection"] = "blocked_intersection"
    stay_s: Seconds | None = 10.0


class ParkingExitBehavior(BlockageBehavior):
    """The ego stands between two parked vehicles."""

    def build(self) -> None:
        """Parks one vehicle before the ego and one behind it."""
        if self.trigger > 5.0:
            raise PlacementError(f"it fits only at the start of a route, at 0 m, not at {self.trigger:.0f} m")
        need_clear_road(self.route, 0.0, self.place + 30.0)
        if section(self.network, self.route, self.place).left < 0:
            raise PlacementError("there is no lane to the left of the ego's lane")
        self.add_vehicle(self.place)
        self.add_side_flow(oncoming=False)
        *_, length, _ = self.vehicle_size
        self.add_vehicle(-0.5 * length - 4.5)


class ParkingExit(BlockageEvent):
    """The ego must pull out from between two parked vehicles."""

    behavior: ClassVar = ParkingExitBehavior
    only_at_start: ClassVar[bool] = True
    kind: Literal["parking_exit"] = "parking_exit"
    ahead_m: Metres = 9.0
    gap_m: Gaps | None = (20.0, 50.0)


class StoppedBehindCurveBehavior(BlockageBehavior):
    """A vehicle stands behind the next bend."""

    def build(self) -> None:
        """Puts the vehicle behind the bend."""
        self.place = self._behind_bend()
        self.add_vehicle(self.place)

    def _behind_bend(self) -> float:
        heading = np.unwrap(self.route.heading)
        for s in np.arange(self.trigger + 10.0, min(self.trigger + 250.0, self.route.length - BEND_M), 1.0):
            row, before = self.route.index(float(s)), self.route.index(float(s) - BEND_M)
            bent = abs(heading[row] - heading[before]) > BEND_RAD
            straight = abs(heading[self.route.index(float(s) + 5.0)] - heading[row]) < 0.05
            if bent and straight and not any(p.entry - 5.0 < s + 5.0 < p.exit + 5.0 for p in self.route.passages):
                return float(s) + 5.0
        raise PlacementError("the route has no bend of 30 degrees within 250 m")


class StoppedBehindCurve(BlockageEvent):
    """A vehicle stands behind a bend of 30 degrees."""

    behavior: ClassVar = StoppedBehindCurveBehavior
    kind: Literal["stopped_behind_curve"] = "stopped_behind_curve"
    stay_s: Seconds | None = 30.0


class AppearingVehicleBehavior(BlockageBehavior):
    """A vehicle appears at the trigger, and disappears after a time."""

    def build(self) -> None:
        """Puts the vehicle on the road ahead."""
        section(self.network, self.route, self.place)
        self.add_vehicle(self.place)
        self._appeared = False

    def prepare(self, context: EventContext) -> None:
        """Does nothing: the vehicle appears at the trigger."""

    def act(self, context: EventContext) -> bool:
        """Adds the vehicle at the first tick after the trigger."""
        if not self._appeared:
            self._appeared = True
            super().prepare(context)
        return super().act(context)

    def leaves(self, context: EventContext) -> bool:
        """Removes the vehicle when its time is over."""
        if not super().leaves(context):
            return False
        for actor in self.actors:
            actor.present = False
        return True


class VehicleAppears(BlockageEvent):
    """A vehicle appears ahead of the ego, and disappears after a time."""

    behavior: ClassVar = AppearingVehicleBehavior
    kind: Literal["vehicle_appears"] = "vehicle_appears"
    ahead_m: Metres = 30.0
    stay_s: Seconds | None = 10.0
