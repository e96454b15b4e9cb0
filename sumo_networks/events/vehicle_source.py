"""VehicleSource: SUMO's own vehicles enter one after the other, with gaps for the ego."""

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
    """Source of the vehicles of a flow, with random gaps.

    Attributes:
        entered: Names of the vehicles that have entered so far.
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
        """Finds the place at which the vehicles enter.

        Args:
            network: The road network.
            lanes: Connected lanes of the flow.
            meeting_s: Arc length along the lanes at which they meet the ego's path, m.
            source_m: Largest distance before the meeting point at which the vehicles enter, m.
            gap_m: Smallest and largest gap, m.
            speed: Highest speed of the vehicles, m/s; None: the limit.
        """
        self.entered: list[str] = []
        self._network, self._lanes, self._meeting, self._gap, self._max = network, lanes, meeting_s, gap_m, speed
        self._start = max(meeting_s - source_m, VEHICLE_M + 0.1)
        limit = float(network.lanes.speed[lanes[0]])
        self._speed = min(limit, speed or limit)
        self._next = -np.inf

    def emit(self, event: str, context: EventContext, rng: np.random.Generator) -> None:
        """Lets the next vehicle enter if it is due and the last one has found room.

        At the first call several vehicles enter along the lanes, as if the flow had been running before.
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
        network: The road network.
        route: The ego's route.
        lane: Lane beside the ego's lane.
        s: Arc length on the route at which the lanes are side by side, m.
        source_m: Distance before that point at which the flow begins, m.

    Returns:
        The lanes, and the arc length of the point on them, m.
    """
    before = upstream(network, lane, source_m + float(network.lanes.length[lane]))
    at, _ = lane_path(network, [lane]).project(route.position[route.index(s)][None], 0.0, np.inf)
    meeting_s = float(network.lanes.length[before[:-1]].sum()) + float(at[0])
    return [*before[:-1], *downstream(network, lane, LEAVE_M)], meeting_s


def side_flow(
    network: RoadNetwork, route: Route, s: float, gap_m: tuple[float, float], oncoming: bool
) -> VehicleSource:
    """Flow in the lane to the left of the ego's lane, oncoming or in the same direction.

    Raises:
        PlacementError: The road has no such lane.
    """
    found = section(network, route, s)
    lane = found.oncoming if oncoming else found.left
    if lane < 0:
        raise PlacementError(f"there is no {'oncoming lane' if oncoming else 'lane to the left'} at {s:.0f} m")
    lanes, meeting_s = lanes_through(network, route, lane, s, SOURCE_M)
    return VehicleSource(network, lanes, meeting_s, SOURCE_M, gap_m, None)
