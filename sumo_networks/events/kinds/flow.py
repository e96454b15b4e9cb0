"""Flows: SUMO's own vehicles enter one after the other, and the ego must find a gap."""

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
"""Meeting point of ego and flow on the route [m], the flow's lanes, and the meeting point on the lanes [m]."""


class FlowBehavior(EventBehavior["FlowEvent"]):
    """Vehicles enter until the ego is past the meeting point.

    Attributes:
        meeting: Arc length of the meeting point on the ego's route, m.
        source: Source of the vehicles.
    """

    def __init__(self, event: FlowEvent, site: EventSite) -> None:
        super().__init__(event, site)
        self.meeting, lanes, meeting_s = event.find_meeting(site)
        self.source = VehicleSource(site.network, lanes, meeting_s, event.source_m, event.gap_m, event.speed_mps)

    @property
    def entered(self) -> Sequence[str]:
        """Names of the flow's vehicles."""
        return self.source.entered

    def prepare(self, context: EventContext) -> None:
        """Lets the first vehicle enter."""
        self.source.emit(self.event.name, context, self.rng)

    def await_trigger(self, context: EventContext) -> None:
        """Keeps the flow running, so that the road is full when the ego arrives; pauses if a queue blocks the ego."""
        if not self.queues(context, self.meeting):
            self.source.emit(self.event.name, context, self.rng)

    def act(self, context: EventContext) -> bool:
        """Keeps the flow running until the ego is past the meeting point."""
        self.await_trigger(context)
        return context.distance_to(self.meeting) < -self.event.past_m

    def withdraw(self, context: EventContext) -> None:
        """Cancels the waiting vehicles; vehicles on the road drive on as part of the traffic."""
        self.source.stop(context)


class FlowEvent(BaseEvent):
    """A flow of SUMO's own vehicles with gaps, which the ego must cross or join.

    Attributes:
        gap_m: Smallest and largest gap between two vehicles, m.
        speed_mps: Highest speed of the vehicles, m/s; None: the limit.
        source_m: Largest distance before the meeting point at which the vehicles enter, m.
        past_m: Distance of the ego past the meeting point at which the event ends, m.
    """

    behavior: ClassVar = FlowBehavior

    gap_m: Gaps = (20.0, 50.0)
    speed_mps: Speed | None = None
    source_m: Metres = 120.0
    past_m: Metres = 20.0

    def find_meeting(self, site: EventSite) -> Meeting:
        """Finds the meeting point of ego and flow.

        Raises:
            PlacementError: The ego's route has no such point.
        """
        raise NotImplementedError


class JunctionFlow(FlowEvent):
    """A flow through the next junction."""

    def find_meeting(self, site: EventSite) -> Meeting:
        """Finds the meeting point of the ego and the first path through the junction that fits.

        Raises:
            PlacementError: The junction does not fit the kind, or none of its paths does.
        """
        passage = next_passage(site.network, site.route, site.trigger)
        self.check_junction(passage, f"the junction at {passage.entry:.0f} m", site.route)
        for way in conflicting_ways(site.network, site.route, passage, self.source_m):
            if self.takes(way, site.network):
                return way.own_s, way.lanes, way.path_s
        raise PlacementError(f"no flow of this kind meets the ego's path through the junction at {passage.entry:.0f} m")

    def check_junction(self, passage: Passage, where: str, route: Route) -> None:
        """Raises PlacementError if the junction does not fit the kind."""
        raise NotImplementedError

    def takes(self, way: ConflictingWay, network: RoadNetwork) -> bool:
        """Whether the flow may use a path: by default, straight on from the opposite side."""
        return way.side == "opposite" and bool(network.connections.direction[way.connection] == "s")


class LeftTurnFlow(JunctionFlow):
    """The ego turns left across a flow of oncoming vehicles.

    Attributes:
        lit: Whether the junction has a traffic light.
    """

    lit: ClassVar[bool] = False

    def check_junction(self, passage: Passage, where: str, route: Route) -> None:
        """Raises PlacementError if the route does not turn left, or if the junction's lights differ from `lit`."""
        if passage.command is not Command.LEFT:
            raise PlacementError(f"the route does not turn left at {where}")
        if (lit := passage.signal >= 0) != self.lit:
            raise PlacementError(f"{where} has {'a' if lit else 'no'} traffic light")


class LeftTurnSignalised(LeftTurnFlow):
    """The ego turns left across oncoming vehicles at a junction with a light."""

    lit: ClassVar[bool] = True
    kind: Literal["left_turn_signalised"] = "left_turn_signalised"


class LeftTurnUnsignalised(LeftTurnFlow):
    """The ego turns left across oncoming vehicles at a junction without a light."""

    kind: Literal["left_turn_unsignalised"] = "left_turn_unsignalised"


class InterurbanLeftTurn(LeftTurnFlow):
    """The ego turns left off a fast road, without a light."""

    kind: Literal["interurban_left_turn"] = "interurban_left_turn"

    def check_junction(self, passage: Passage, where: str, route: Route) -> None:
        """Raises PlacementError also if the limit is below 50 km/h."""
        super().check_junction(passage, where, route)
        limit = float(route.speed_limit[route.index(passage.entry - 2.0)])
        if limit < INTERURBAN_MPS:
            raise PlacementError(
                f"the limit before {where} is {KMH_PER_MPS * limit:.0f} km/h, at least 50 km/h are expected"
            )


class RightTurnIntoFlow(JunctionFlow):
    """The ego turns right into a flow of vehicles from the left."""

    kind: Literal["right_turn_into_flow"] = "right_turn_into_flow"

    def check_junction(self, passage: Passage, where: str, route: Route) -> None:
        """Raises PlacementError if the route does not turn right."""
        if passage.command is not Command.RIGHT:
            raise PlacementError(f"the route does not turn right at {where}")

    def takes(self, way: ConflictingWay, network: RoadNetwork) -> bool:
        """Whether a path comes from the left and leads to the ego's next edge."""
        return way.side == "left" and way.merges


class EnterActorFlow(JunctionFlow):
    """The ego must give way to a flow at a junction without a light."""

    kind: Literal["enter_actor_flow"] = "enter_actor_flow"

    def check_junction(self, passage: Passage, where: str, route: Route) -> None:
        """Raises PlacementError if the junction has a traffic light."""
        if passage.signal >= 0:
            raise PlacementError(f"{where} has a traffic light")

    def takes(self, way: ConflictingWay, network: RoadNetwork) -> bool:
        """Whether the ego must give way to vehicles on a path."""
        return way.ego_yields


class MergeIntoSlowTraffic(FlowEvent):
    """The ego changes to, or merges into, a lane of slow vehicles."""

    kind: Literal["merge_into_slow_traffic"] = "merge_into_slow_traffic"
    speed_mps: Speed | None = 5.0

    def find_meeting(self, site: EventSite) -> Meeting:
        """Finds the ego's next lane change or merge.

        Raises:
            PlacementError: The route has none within 400 m.
        """
        beside = lane_change_meeting(site, (Command.CHANGE_LEFT, Command.CHANGE_RIGHT), self.source_m)
        if beside is not None:
            return beside
        passage = next_passage(site.network, site.route, site.trigger, LANE_CHANGE_WITHIN_M)
        for way in conflicting_ways(site.network, site.route, passage, self.source_m):
            if way.side == "same" and way.merges:
                return way.own_s, way.lanes, way.path_s
        raise PlacementError(f"the route has no lane change or merge within {LANE_CHANGE_WITHIN_M:.0f} m")


class HighwayExit(FlowEvent):
    """The ego changes to the right, into a lane with a flow."""

    kind: Literal["highway_exit"] = "highway_exit"

    def find_meeting(self, site: EventSite) -> Meeting:
        """Finds the ego's next lane change to the right.

        Raises:
            PlacementError: The route has none within 400 m.
        """
        beside = lane_change_meeting(site, (Command.CHANGE_RIGHT,), self.source_m)
        if beside is None:
            raise PlacementError(f"the route has no lane change to the right within {LANE_CHANGE_WITHIN_M:.0f} m")
        return beside


def lane_change_meeting(site: EventSite, commands: Sequence[Command], source_m: float) -> Meeting | None:
    """The ego's next lane change with one of the commands, and the lanes of the flow beside it."""
    route = site.route
    for change in route.lane_changes:
        if site.trigger <= change.start <= site.trigger + LANE_CHANGE_WITHIN_M and change.command in commands:
            target = int(route.lane[route.index(change.end)])
            lanes, meeting_s = lanes_through(site.network, route, target, change.end, source_m)
            return change.end, lanes, meeting_s
    return None
