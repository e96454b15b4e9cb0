"""Fleet: the egos' vehicles, which dohyo moves instead of SUMO, and their places on routes and lanes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.ego.dynamics import (
    ACCELERATION,
    HEADING,
    SPEED,
    STEERING,
    YAW_RATE,
    VehicleParameters,
    Vehicles,
)
from dohyo.sumo_networks.ego.pose import Pose
from dohyo.sumo_networks.geometry import wrap
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.world import Egos

NOBODY: Mapping[int, Pose] = MappingProxyType({})


class EgoFleet:
    """The egos of one episode.

    Attributes:
        active: (E,) whether the ego's episode continues.
        centres: (E, 2), m: centres of the boxes.
    """

    def __init__(
        self,
        network: RoadNetwork,
        names: tuple[str, ...],
        routes: tuple[Route, ...],
        vehicle: VehicleParameters,
        speeds: Sequence[float] = (),
    ) -> None:
        """Places the egos at the starts of their routes, at given speeds [m/s] or at rest."""
        self._network, self._names, self._routes, self._vehicle = network, names, routes, vehicle
        self._vehicles = Vehicles(vehicle, len(names))
        for ego, route in enumerate(routes):
            x, y = route.position[0].tolist()
            self._vehicles.place(ego, x, y, route.heading.item(0), speeds[ego] if speeds else 0.0)
        self.active: BoolArray = np.ones(len(names), dtype=np.bool_)
        self.centres: FloatArray = self._vehicles.centres()
        self._driven = np.zeros(len(names))
        self._length, self._width = np.full(len(names), vehicle.length), np.full(len(names), vehicle.width)

    def heading(self, ego: int) -> float:
        """Heading of one ego, rad."""
        return self._vehicles.states.item(ego, HEADING)

    def advance(self, commands: FloatArray, seconds: float, poses: Mapping[int, Pose] = NOBODY) -> None:
        """Drives the active egos for a time.

        Args:
            commands: (E, 2) demanded drive [m/s^2] and front wheel angle [rad]; rows of inactive egos are ignored.
            seconds: Length of the drive, a multiple of the substep of 0.01 s.
            poses: Poses after that time of the active egos whose vehicles are simulated elsewhere.
        """
        before, ended = self.centres, ~self.active
        frozen, still = self._vehicles.states[ended], self._vehicles.motion[ended, -1:]
        earlier = {ego: self._vehicles.states[ego].copy() for ego in poses}
        self._vehicles.advance(commands, seconds)
        self._vehicles.states[ended], self._vehicles.motion[ended] = frozen, still
        for ego, pose in poses.items():
            self._put(ego, pose, earlier[ego], seconds)
        self.centres = self._vehicles.centres()
        moved = self.centres - before
        self._driven = self._driven + np.hypot(moved[:, 0], moved[:, 1])

    def _put(self, ego: int, pose: Pose, earlier: FloatArray, seconds: float) -> None:
        heading, speed = wrap(pose.heading), pose.speed
        acceleration = (speed - earlier.item(SPEED)) / seconds
        yaw_rate = wrap(heading - earlier.item(HEADING)) / seconds
        self._vehicles.put(ego, np.array(pose[:2]), heading, speed, (acceleration, yaw_rate))

    def read(self, before: Egos | None) -> Egos:
        """States of the egos, on their routes and on the lanes.

        Args:
            before: States one tick earlier; None at the start.
        """
        columns, centres = self._vehicles.states.T.copy(), self.centres
        near = before.progress.tolist() if before else [0.0] * len(self._names)
        on_route, on_lane = [], []
        for route, (x, y), heading, at in zip(
            self._routes, centres.tolist(), columns[HEADING].tolist(), near, strict=True
        ):
            along, aside, direction = route.project(x, y, at)
            on_route.append((along, aside, wrap(heading - direction)))
            on_lane.append(self._network.nearest_lane(x, y, heading, route.on_route))
        progress, lateral, error = (np.array(column) for column in zip(*on_route, strict=True))
        lane, lane_offset, lane_error = (np.array(column) for column in zip(*on_lane, strict=True))
        return Egos(
            names=self._names,
            active=self.active.copy(),
            position=centres,
            heading=columns[HEADING],
            speed=columns[SPEED],
            acceleration=columns[ACCELERATION],
            yaw_rate=columns[YAW_RATE],
            steering=columns[STEERING],
            length=self._length,
            width=self._width,
            progress=progress,
            lateral=lateral,
            route_heading_error=error,
            lane=lane,
            lane_offset=lane_offset,
            lane_heading_error=lane_error,
            driven=self._driven,
            motion=self._vehicles.motion,
        )
