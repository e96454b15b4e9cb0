"""VehicleSource: SUMO's own vehicles enter one after the other with gaps, in which the ego must fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dohyo.sumo_networks.actors.names import event_vehicle
from dohyo.sumo_networks.actors.paths import downstream, edges_of, lane_path, upstream
from dohyo.sumo_networks.actors.requests import CancelVehicle, SpawnVehicle
from dohyo.sumo_networks.events.behavior import EventContext, PlacementError
from dohyo.sumo_networks.events.roads import section

if TYPE_CHECKING:  # scenarios are read without roads, whose numeric kernels take long to import
    from dohyo.sumo_networks.networks.network import RoadNetwork
    from dohyo.sumo_networks.routes.route import Route

VEHICLE_M = 4.6
LEAVE_M = 300.0
CLEAR_M = 10.0
SOURCE_M = 120.0


class VehicleSource:
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

    def emit(self, event: str, context: EventContext, rng: np.random.Generator) -> None:
        """Lets the next vehicle enter, if its time has come and the last one has found room.

        The first comes with others ahead of it, as if they had been coming all the time.
        """
        if context.time < self._next or (self.entered and self.entered[-1] not in context.departed):
            return
        if not self.entered:
            s = self._start + float(rng.uniform(*self._gap)) + VEHICLE_M
            while s < self._meeting - CLEAR_M:
                self._enter(event, context, s)
                s += float(rng.uniform(*self._gap)) + VEHICLE_M
        self._enter(event, context, self._start)
        self._next = context.time + (float(rng.uniform(*self._gap)) + VEHICLE_M) / self._speed

    def _enter(self, event: str, context: EventContext, s: float) -> None:
        lanes, rest = self._network.lanes, list(self._lanes)
        while len(rest) > 1 and (s > lanes.length[rest[0]] or lanes.internal[rest[0]]):
            s -= float(lanes.length[rest.pop(0)])
        position = min(max(s, VEHICLE_M + 0.1), float(lanes.length[rest[0]]))
        name, lane = event_vehicle(event, len(self.entered)), str(int(lanes.index[rest[0]]))
        self.entered.append(name)
        context.requests.append(
            SpawnVehicle(name, "car", edges_of(self._network, rest), lane, str(position), "desired", self._max)
        )

    def stop(self, context: EventContext) -> None:
        """Cancels the vehicles that still wait for room."""
        context.requests.extend(CancelVehicle(name) for name in self.entered if name not in context.departed)
        self.entered = [name for name in self.entered if name in context.departed]


def lanes_through(network: RoadNetwork, route: Route, lane: int, s: float, source_m: float) -> tuple[list[int], float]:
    """The lanes of a flow that drives beside the ego's lane.

    Args:
        network: The roads.
        route: The ego's.
        lane: The one beside.
        s: Where it is beside the ego's, m along the route.
        source_m: How far before that the flow begins.

    Returns:
        The lanes, and where on them, in metres, that place is.
    """
    before = upstream(network, lane, source_m + float(network.lanes.length[lane]))
    at, _ = lane_path(network, [lane]).project(route.position[route.index(s)][None], 0.0, np.inf)
    meeting_s = float(network.lanes.length[before[:-1]].sum()) + float(at[0])
    return [*before[:-1], *downstream(network, lane, LEAVE_M)], meeting_s


def side_flow(
    network: RoadNetwork, route: Route, s: float, gap_m: tuple[float, float], oncoming: bool
) -> VehicleSource:
    """The flow in the lane to the left of the ego's, of the other direction or of the same.

    Raises:
        PlacementError: There is no such lane.
    """
    found = section(network, route, s)
    lane = found.oncoming if oncoming else found.left
    if lane < 0:
        raise PlacementError(f"there is no {'oncoming lane' if oncoming else 'lane to the left'} at {s:.0f} m")
    lanes, meeting_s = lanes_through(network, route, lane, s, SOURCE_M)
    return VehicleSource(network, lanes, meeting_s, SOURCE_M, gap_m, None)
