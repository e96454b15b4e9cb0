"""Fleet: the egos' vehicles, which are ours and not SUMO's, and where they are on the roads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sumo_networks.arrays import BoolArray, FloatArray
from sumo_networks.geometry import wrap
from sumo_networks.network import RoadNetwork
from sumo_networks.routing import Route
from sumo_networks.vehicle import ACCELERATION, HEADING, SPEED, STEERING, YAW_RATE, VehicleParameters, Vehicles
from sumo_networks.world import Egos


class Fleet:
    """The egos, from their starts on.

    Attributes:
        active: (E,) whether the ego's episode goes on.
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
        """Puts the egos at the starts of their routes, at given speeds [m/s] or at rest."""
        self._network, self._names, self._routes, self._vehicle = network, names, routes, vehicle
        self._vehicles = Vehicles(vehicle, len(names))
        for ego, route in enumerate(routes):
            x, y = route.position[0].tolist()
            self._vehicles.place(ego, x, y, route.heading.item(0), speeds[ego] if speeds else 0.0)
        self.active: BoolArray = np.ones(len(names), dtype=np.bool_)
        self.centres: FloatArray = self._vehicles.centres()
        self._driven = np.zeros(len(names))

    def heading(self, ego: int) -> float:
        """Of one ego, rad."""
        return self._vehicles.states.item(ego, HEADING)

    def advance(self, commands: FloatArray, seconds: float) -> None:
        """Drives the active egos for a while.

        Args:
            commands: (E, 2) demanded drive [m/s^2] and front wheel angle [rad]; rows of inactive egos are ignored.
            seconds: A multiple of the substep of 0.01 s.
        """
        before = self.centres
        frozen = self._vehicles.states[~self.active].copy()
        self._vehicles.advance(commands, seconds)
        self._vehicles.states[~self.active] = frozen
        self.centres = self._vehicles.centres()
        self._driven += np.hypot(*(self.centres - before).T)

    def read(self, before: Egos | None) -> Egos:
        """Where the egos are, on their routes and on the lanes.

        Args:
            before: A tick earlier; None at the start.
        """
        states, centres = self._vehicles.states, self.centres
        count = len(self._names)
        progress, lateral, error = np.zeros(count), np.zeros(count), np.zeros(count)
        lane, lane_offset, lane_error = np.full(count, -1), np.full(count, np.nan), np.full(count, np.nan)
        for ego, route in enumerate(self._routes):
            x, y = centres[ego].tolist()
            heading = states.item(ego, HEADING)
            near = float(before.progress[ego]) if before else 0.0
            progress[ego], lateral[ego], direction = route.project(x, y, near)
            error[ego] = wrap(heading - direction)
            lane[ego], lane_offset[ego], lane_error[ego] = self._network.nearest_lane(x, y, heading, route.on_route)
        return Egos(
            names=self._names,
            active=self.active.copy(),
            position=centres,
            heading=states[:, HEADING].copy(),
            speed=states[:, SPEED].copy(),
            acceleration=states[:, ACCELERATION].copy(),
            yaw_rate=states[:, YAW_RATE].copy(),
            steering=states[:, STEERING].copy(),
            length=np.full(count, self._vehicle.length),
            width=np.full(count, self._vehicle.width),
            progress=progress,
            lateral=lateral,
            route_heading_error=error,
            lane=lane,
            lane_offset=lane_offset,
            lane_heading_error=lane_error,
            driven=self._driven.copy(),
            motion=self._vehicles.motion,
        )
