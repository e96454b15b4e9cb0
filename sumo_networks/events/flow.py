"""Flows: SUMO's own vehicles enter one after the other with gaps, and the ego must find one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dohyo.sumo_networks.events.configs import Flow
from dohyo.sumo_networks.events.paths import downstream, edges_of, lane_path, upstream
from dohyo.sumo_networks.events.roads import ConflictingStream, next_passage, section, streams
from dohyo.sumo_networks.events.script import Moment, Script, Unfit
from dohyo.sumo_networks.events.stage import Entry
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Command, Passage, Route

INTERURBAN_MPS = 50 / 3.6 - 0.1
VEHICLE_M = 4.6
LANE_CHANGE_WITHIN_M = 400.0
LEAVE_M = 300.0
CLEAR_M = 10.0
SOURCE_M = 120.0


class Source:
    """Where vehicles of a flow enter, and at which gaps.

    Attributes:
        entered: Names of those that have come so far.
    """

    def __init__(
        self,
        network: RoadNetwork,
        lanes: Sequence[int],
        meeting_s: float,
        source_m: float,
        gap_m: tuple[float, float],
        speed: float | None,
    ) -> None:
        """Finds the place where they enter.

        Args:
            network: The roads.
            lanes: Connected lanes that they drive.
            meeting_s: Where on them they meet the ego, m.
            source_m: How far before that they enter, at most.
            gap_m: Smallest and largest gap.
            speed: Their highest speed, m/s; None: the limit.
        """
        self.entered: list[str] = []
        self._network, self._lanes, self._meeting, self._gap, self._max = network, lanes, meeting_s, gap_m, speed
        self._start = max(meeting_s - source_m, VEHICLE_M + 0.1)
        limit = float(network.lanes.speed[lanes[0]])
        self._speed = min(limit, speed or limit)
        self._next = -np.inf

    def emit(self, name: str, moment: Moment, rng: np.random.Generator) -> None:
        """Lets the next vehicle enter, if its time has come and the last one has found room.

        The first comes with others ahead of it, as if they had been coming all the time.
        """
        if moment.time < self._next or (self.entered and not moment.stage.entered(self.entered[-1])):
            return
        if not self.entered:
            s = self._start + float(rng.uniform(*self._gap)) + VEHICLE_M
            while s < self._meeting - CLEAR_M:
                self._enter(name, moment, s)
                s += float(rng.uniform(*self._gap)) + VEHICLE_M
        self._enter(name, moment, self._start)
        self._next = moment.time + (float(rng.uniform(*self._gap)) + VEHICLE_M) / self._speed

    def _enter(self, name: str, moment: Moment, s: float) -> None:
        lanes, rest = self._network.lanes, list(self._lanes)
        while len(rest) > 1 and (s > lanes.length[rest[0]] or lanes.internal[rest[0]]):
            s -= float(lanes.length[rest.pop(0)])
        position = min(max(s, VEHICLE_M + 0.1), float(lanes.length[rest[0]]))
        entry = Entry("car", edges_of(self._network, rest), int(lanes.index[rest[0]]), position, self._max)
        self.entered.append(f"event:{name}-flow{len(self.entered)}")
        moment.stage.enter(self.entered[-1], entry)

    def stop(self, moment: Moment) -> None:
        """Takes those back that still wait for room."""
        for name in self.entered:
            if not moment.stage.entered(name):
                moment.stage.withdraw(name)
        self.entered = [name for name in self.entered if moment.stage.entered(name)]


class FlowScript(Script):
    """Vehicles keep coming until the ego is past the place where it meets them.

    Attributes:
        meeting: Where that is, m along the ego's route.
        source: Where they enter.
    """

    def __init__(
        self, event: Flow, trigger: float, network: RoadNetwork, route: Route, rng: np.random.Generator
    ) -> None:
        super().__init__(event, trigger, network, route, rng)
        self.event = event
        if self.kind in ("merge_into_slow_traffic", "highway_exit"):
            self.meeting, lanes, meeting_s = self._beside()
        else:
            self.meeting, lanes, meeting_s = self._across()
        self.source = Source(network, lanes, meeting_s, event.source_m, event.gap_m, event.speed_mps)

    def _across(self) -> tuple[float, Sequence[int], float]:
        passage = next_passage(self.network, self.route, self.trigger)
        self._check_junction(passage)
        for stream in streams(self.network, self.route, passage, self.event.source_m):
            if self._fits(stream):
                return stream.own_s, stream.lanes, stream.path_s
        raise Unfit(f"no such stream meets the ego's way through the junction at {passage.entry:.0f} m")

    def _check_junction(self, passage: Passage) -> None:
        lit, where = passage.signal >= 0, f"the junction at {passage.entry:.0f} m"
        if self.kind.startswith("left_turn") or self.kind == "interurban_left_turn":
            if passage.command is not Command.LEFT:
                raise Unfit(f"the route does not turn left at {where}")
            if lit != (self.kind == "left_turn_signalised"):
                raise Unfit(f"{where} has {'a' if lit else 'no'} traffic light")
        limit = float(self.route.speed_limit[self.route.index(passage.entry - 2.0)])
        if self.kind == "interurban_left_turn" and limit < INTERURBAN_MPS:
            raise Unfit(f"the limit before {where} is {3.6 * limit:.0f} km/h, at least 50 km/h are expected")
        if self.kind == "right_turn_into_flow" and passage.command is not Command.RIGHT:
            raise Unfit(f"the route does not turn right at {where}")
        if self.kind == "enter_actor_flow" and lit:
            raise Unfit(f"{where} has a traffic light")

    def _fits(self, stream: ConflictingStream) -> bool:
        if self.kind == "right_turn_into_flow":
            return stream.side == "left" and stream.merges
        if self.kind == "enter_actor_flow":
            return stream.ego_yields
        straight = self.network.connections.direction[stream.connection] == "s"
        return stream.side == "opposite" and bool(straight)

    def _beside(self) -> tuple[float, Sequence[int], float]:
        """Where the ego changes to or merges into another lane, the lanes of those who are there, and where on them."""
        wanted = (Command.CHANGE_RIGHT,) if self.kind == "highway_exit" else (Command.CHANGE_LEFT, Command.CHANGE_RIGHT)
        for change in self.route.lane_changes:
            if self.trigger <= change.start <= self.trigger + LANE_CHANGE_WITHIN_M and change.command in wanted:
                target = int(self.route.lane[self.route.index(change.end)])
                lanes, meeting_s = lanes_through(self.network, self.route, target, change.end, self.event.source_m)
                return change.end, lanes, meeting_s
        if self.kind == "merge_into_slow_traffic":
            passage = next_passage(self.network, self.route, self.trigger, LANE_CHANGE_WITHIN_M)
            for stream in streams(self.network, self.route, passage, self.event.source_m):
                if stream.side == "same" and stream.merges:
                    return stream.own_s, stream.lanes, stream.path_s
        what = "lane change to the right" if self.kind == "highway_exit" else "lane change or merging stream"
        raise Unfit(f"the route has no {what} within {LANE_CHANGE_WITHIN_M:.0f} m")

    @property
    def entered(self) -> Sequence[str]:
        """Names of the vehicles."""
        return self.source.entered

    def prepare(self, moment: Moment) -> None:
        """The first vehicle enters."""
        self.source.emit(self.name, moment, self.rng)

    def await_trigger(self, moment: Moment) -> None:
        """So do others, so that the road is full when the ego comes; but not while they keep others before it."""
        if not self.queues(moment, self.meeting):
            self.source.emit(self.name, moment, self.rng)

    def act(self, moment: Moment) -> bool:
        """They keep coming until the ego is past them."""
        self.await_trigger(moment)
        return moment.distance_to(self.meeting) < -self.event.past_m

    def withdraw(self, moment: Moment) -> None:
        """Nobody enters any more; those on the road drive on, and leave it as the traffic does."""
        self.source.stop(moment)


def lanes_through(network: RoadNetwork, route: Route, lane: int, s: float, source_m: float) -> tuple[list[int], float]:
    """The lanes of a stream that drives on a lane beside the ego's.

    Args:
        network: The roads.
        route: The ego's.
        lane: The one beside.
        s: Where it is beside the ego's, m along the route.
        source_m: How far before that the stream begins.

    Returns:
        The lanes, and where on them, in metres, that place is.
    """
    before = upstream(network, lane, source_m + float(network.lanes.length[lane]))
    at, _ = lane_path(network, [lane]).project(route.position[route.index(s)][None], 0.0, np.inf)
    meeting_s = float(network.lanes.length[before[:-1]].sum()) + float(at[0])
    return [*before[:-1], *downstream(network, lane, LEAVE_M)], meeting_s


def side_flow(network: RoadNetwork, route: Route, s: float, gap_m: tuple[float, float], oncoming: bool) -> Source:
    """The flow in the lane to the left of the ego's, of the other direction or of the same.

    Raises:
        Unfit: There is no such lane.
    """
    found = section(network, route, s)
    lane = found.oncoming if oncoming else found.left
    if lane < 0:
        raise Unfit(f"there is no {'oncoming lane' if oncoming else 'lane to the left'} at {s:.0f} m")
    lanes, meeting_s = lanes_through(network, route, lane, s, SOURCE_M)
    return Source(network, lanes, meeting_s, SOURCE_M, gap_m, None)
