"""Flows: SUMO's own vehicles enter one after the other with gaps, and the ego must find one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, Literal

from dohyo.sumo_networks.events.behavior import EventBehavior, EventContext, EventSite, PlacementError
from dohyo.sumo_networks.events.event import BaseEvent, Gaps, Metres, Speed
from dohyo.sumo_networks.events.roads import ConflictingWay, conflicting_ways, next_passage
from dohyo.sumo_networks.events.vehicle_source import VehicleSource, lanes_through
from dohyo.sumo_networks.routes.command import Command
from dohyo.sumo_networks.units import KMH_PER_MPS

if TYPE_CHECKING:  # scenarios are read without roads, whose numeric kernels take long to import
    from dohyo.sumo_networks.networks.network import RoadNetwork
    from dohyo.sumo_networks.routes.route import Passage, Route

INTERURBAN_MPS = 50 / KMH_PER_MPS - 0.1
LANE_CHANGE_WITHIN_M = 400.0
Meeting = tuple[float, Sequence[int], float]
"""Where the ego meets a flow, m along its route; the flow's lanes; where on them, m."""


class FlowBehavior(EventBehavior["FlowEvent"]):
    """Vehicles keep coming until the ego is past the place where it meets them.

    Attributes:
        meeting: Where that is, m along the ego's route.
        source: Where they enter.
    """

    def __init__(self, event: FlowEvent, site: EventSite) -> None:
        super().__init__(event, site)
        self.meeting, lanes, meeting_s = event.find_meeting(site)
        self.source = VehicleSource(site.network, lanes, meeting_s, event.source_m, event.gap_m, event.speed_mps)

    @property
    def entered(self) -> Sequence[str]:
        """Names of the vehicles."""
        return self.source.entered

    def prepare(self, context: EventContext) -> None:
        """The first vehicle enters."""
        self.source.emit(self.event.name, context, self.rng)

    def await_trigger(self, context: EventContext) -> None:
        """So do others, so that the road is full when the ego comes; but not while they keep others before it."""
        if not self.queues(context, self.meeting):
            self.source.emit(self.event.name, context, self.rng)

    def act(self, context: EventContext) -> bool:
        """They keep coming until the ego is past them."""
        self.await_trigger(context)
        return context.distance_to(self.meeting) < -self.event.past_m

    def withdraw(self, context: EventContext) -> None:
        """Cancels the vehicles that wait; those on the road drive on, and leave it as the traffic does."""
        self.source.stop(context)


class FlowEvent(BaseEvent):
    """A stream of SUMO's own vehicles with gaps, through which or into which the ego must go.

    Attributes:
        gap_m: Smallest and largest gap between two vehicles.
        speed_mps: Their highest speed; None: the limit's.
        source_m: How far before the meeting point they enter, at most.
        past_m: It is over when the ego is so far past the meeting point.
    """

    behavior: ClassVar = FlowBehavior

    gap_m: Gaps = (20.0, 50.0)
    speed_mps: Speed | None = None
    source_m: Metres = 120.0
    past_m: Metres = 20.0

    def find_meeting(self, site: EventSite) -> Meeting:
        """Where the ego meets the flow.

        Raises:
            PlacementError: Nowhere on its way.
        """
        raise NotImplementedError


class JunctionFlow(FlowEvent):
    """The flow comes through the next junction."""

    def find_meeting(self, site: EventSite) -> Meeting:
        """Where the ego meets the first way of the junction that fits.

        Raises:
            PlacementError: The junction or all its ways are of another sort.
        """
        passage = next_passage(site.network, site.route, site.trigger)
        self.check_junction(passage, f"the junction at {passage.entry:.0f} m", site.route)
        for way in conflicting_ways(site.network, site.route, passage, self.source_m):
            if self.takes(way, site.network):
                return way.own_s, way.lanes, way.path_s
        raise PlacementError(f"no such stream meets the ego's way through the junction at {passage.entry:.0f} m")

    def check_junction(self, passage: Passage, where: str, route: Route) -> None:
        """Raises PlacementError where the junction is of another sort."""
        raise NotImplementedError

    def takes(self, way: ConflictingWay, network: RoadNetwork) -> bool:
        """Whether the flow may come along a way: by default straight on from the opposite side."""
        return way.side == "opposite" and bool(network.connections.direction[way.connection] == "s")


class LeftTurnFlow(JunctionFlow):
    """The ego turns left across oncoming vehicles.

    Attributes:
        lit: Whether the junction has a traffic light.
    """

    lit: ClassVar[bool] = False

    def check_junction(self, passage: Passage, where: str, route: Route) -> None:
        """Raises PlacementError where the route does not turn left, or the light is missing or too many."""
        if passage.command is not Command.LEFT:
            raise PlacementError(f"the route does not turn left at {where}")
        if (lit := passage.signal >= 0) != self.lit:
            raise PlacementError(f"{where} has {'a' if lit else 'no'} traffic light")


class LeftTurnSignalised(LeftTurnFlow):
    """At a junction with a light."""

    lit: ClassVar[bool] = True
    kind: Literal["left_turn_signalised"] = "left_turn_signalised"


class LeftTurnUnsignalised(LeftTurnFlow):
    """At a junction without a light."""

    kind: Literal["left_turn_unsignalised"] = "left_turn_unsignalised"


class InterurbanLeftTurn(LeftTurnFlow):
    """Off a fast road, without a light."""

    kind: Literal["interurban_left_turn"] = "interurban_left_turn"

    def check_junction(self, passage: Passage, where: str, route: Route) -> None:
        """Raises PlacementError also where the limit is below 50 km/h."""
        super().check_junction(passage, where, route)
        limit = float(route.speed_limit[route.index(passage.entry - 2.0)])
        if limit < INTERURBAN_MPS:
            raise PlacementError(
                f"the limit before {where} is {KMH_PER_MPS * limit:.0f} km/h, at least 50 km/h are expected"
            )


class RightTurnIntoFlow(JunctionFlow):
    """The ego turns right into the road of vehicles from the left."""

    kind: Literal["right_turn_into_flow"] = "right_turn_into_flow"

    def check_junction(self, passage: Passage, where: str, route: Route) -> None:
        """Raises PlacementError where the route does not turn right."""
        if passage.command is not Command.RIGHT:
            raise PlacementError(f"the route does not turn right at {where}")

    def takes(self, way: ConflictingWay, network: RoadNetwork) -> bool:
        """Whether the flow comes from the left and goes where the ego goes."""
        return way.side == "left" and way.merges


class EnterActorFlow(JunctionFlow):
    """The ego must give way at a junction without a light."""

    kind: Literal["enter_actor_flow"] = "enter_actor_flow"

    def check_junction(self, passage: Passage, where: str, route: Route) -> None:
        """Raises PlacementError where there is a traffic light."""
        if passage.signal >= 0:
            raise PlacementError(f"{where} has a traffic light")

    def takes(self, way: ConflictingWay, network: RoadNetwork) -> bool:
        """Whether the ego must give way to the flow."""
        return way.ego_yields


class MergeIntoSlowTraffic(FlowEvent):
    """The ego changes to, or merges into, a lane of slow vehicles."""

    kind: Literal["merge_into_slow_traffic"] = "merge_into_slow_traffic"
    speed_mps: Speed | None = 5.0

    def find_meeting(self, site: EventSite) -> Meeting:
        """Where the ego next changes lanes or merges.

        Raises:
            PlacementError: Nowhere within 400 m.
        """
        beside = lane_change_meeting(site, (Command.CHANGE_LEFT, Command.CHANGE_RIGHT), self.source_m)
        if beside is not None:
            return beside
        passage = next_passage(site.network, site.route, site.trigger, LANE_CHANGE_WITHIN_M)
        for way in conflicting_ways(site.network, site.route, passage, self.source_m):
            if way.side == "same" and way.merges:
                return way.own_s, way.lanes, way.path_s
        raise PlacementError(f"the route has no lane change or merging stream within {LANE_CHANGE_WITHIN_M:.0f} m")


class HighwayExit(FlowEvent):
    """The ego changes to the right, into a lane of other vehicles."""

    kind: Literal["highway_exit"] = "highway_exit"

    def find_meeting(self, site: EventSite) -> Meeting:
        """Where the ego next changes to the right.

        Raises:
            PlacementError: Nowhere within 400 m.
        """
        beside = lane_change_meeting(site, (Command.CHANGE_RIGHT,), self.source_m)
        if beside is None:
            raise PlacementError(f"the route has no lane change to the right within {LANE_CHANGE_WITHIN_M:.0f} m")
        return beside


def lane_change_meeting(site: EventSite, commands: Sequence[Command], source_m: float) -> Meeting | None:
    """Where the ego next changes lanes in one of the given ways, and the lanes of those that drive there already."""
    route = site.route
    for change in route.lane_changes:
        if site.trigger <= change.start <= site.trigger + LANE_CHANGE_WITHIN_M and change.command in commands:
            target = int(route.lane[route.index(change.end)])
            lanes, meeting_s = lanes_through(site.network, route, target, change.end, source_m)
            return change.end, lanes, meeting_s
    return None
