"""Registry: names, kinds and boxes of everything seen in SUMO, and the images by which SUMO sees the egos."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import chain

import libsumo
import numpy as np
from numba import njit

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.simulation.surroundings import Surroundings
from dohyo.sumo_networks.world import ActorKind, Actors

KINDS = {
    "car": ActorKind.CAR,
    "van": ActorKind.VAN,
    "truck": ActorKind.TRUCK,
    "bus": ActorKind.BUS,
    "bicycle": ActorKind.BICYCLE,
    "emergency": ActorKind.EMERGENCY,
    "pedestrian": ActorKind.PEDESTRIAN,
}
_PEDESTRIAN = int(ActorKind.PEDESTRIAN)
_ANYWHERE = 2  # SUMO's keepRoute: the lane may be off the image's route
_NEAR_M = 5.0  # images are on a lane already; SUMO's 100 m cost 80 us in a junction, these 10 us
INDICATOR = {0: 0, 1: -1, 2: 1, 3: 0}  # SUMO's lowest two bits: right, left
_Point = tuple[float, float]
_Row = tuple[int, float, float, float, float, int, int]  # key, x, y, angle, speed, lane, indicator


class Registry:
    """Names, kinds and boxes of everything seen so far, and the egos' images in SUMO."""

    def __init__(
        self, network: RoadNetwork, scenario: Scenario, vehicle: VehicleParameters, egos: tuple[str, ...]
    ) -> None:
        self.names: list[str] = []
        self._vehicle = vehicle
        self._images = set(egos)
        self._lane_index = network.lane_index
        self._surroundings = Surroundings(scenario.traffic, len(egos))
        self._keys: dict[str, int] = {}
        self._kind: IntArray = np.zeros(256, dtype=np.int64)
        self._length: FloatArray = np.zeros(256)
        self._width: FloatArray = np.zeros(256)
        self._shown: set[str] = set()
        self._obstacles = np.array(
            [
                (self.register(f"obstacle-{i}", ActorKind.STATIC, o.length_m, o.width_m), o.x_m, o.y_m, o.heading_rad)
                for i, o in enumerate(scenario.obstacles)
            ]
        ).reshape(-1, 4)

    def add_ego(self, name: str, route: Route) -> None:
        """Makes SUMO report what is around an ego."""
        libsumo.route.add(name, route.edges)
        self._surroundings.add(name)

    def look_around(self, name: str, x: float, y: float) -> None:
        """Moves the point around which an ego sees, m."""
        self._surroundings.move(name, x, y)

    def move_ego(self, name: str, place: tuple[str, int], front: _Point, angle: float) -> None:
        """Shows an ego on a lane, given by its edge and index."""
        self.move_image(name, "ego", (self._vehicle.length, self._vehicle.width), place, front, angle)

    def move_image(
        self, name: str, vtype: str, size: tuple[float, float], place: tuple[str, int], front: _Point, angle: float
    ) -> None:
        """Shows something of ours as a vehicle on a lane.

        Args:
            name: Of the image and of its route.
            vtype: A vType of vehicle_types.add.xml.
            size: Length and width, m.
            place: Edge id and index of the lane.
            front: Middle of its front bumper, m, network frame.
            angle: SUMO's, degrees clockwise from north.
        """
        if name not in self._shown:
            self._shown.add(name)
            self._images.add(name)
            libsumo.vehicle.add(name, name, vtype, departLane="free", departPos="base", departSpeed="0")
            libsumo.vehicle.setLength(name, size[0])
            libsumo.vehicle.setWidth(name, size[1])
            libsumo.vehicle.setSpeedMode(name, 0)
            libsumo.vehicle.setLaneChangeMode(name, 0)
        libsumo.vehicle.moveToXY(name, *place, *front, angle, _ANYWHERE, _NEAR_M)

    def strayed(self, name: str) -> bool:
        """Whether SUMO found no lane for an image, as it may past the end of one."""
        return name in self._shown and not libsumo.vehicle.getLaneID(name)

    def hide_image(self, name: str) -> None:
        """Takes away the image of an ego or puppet that is off the road.

        SUMO keeps a vehicle that moveToXY led off the road on the books of its last lane, and dies of a segmentation
        fault when another vehicle comes along there.
        """
        if name in self._shown:
            self._shown.remove(name)
            libsumo.vehicle.remove(name)

    def forget_ego(self, name: str) -> None:
        """Takes an ego's image away, and the report of what is around it."""
        self._surroundings.forget(name)
        self.hide_image(name)

    def read(self) -> Actors:
        """Everything within sight of the egos, in the order of keys."""
        images, keys, lanes = self._images, self._keys, self._lane_index
        readings = [reading for reading in self._surroundings.read() if reading[0] not in images]
        for name in sorted({reading[0] for reading in readings if reading[0] not in keys}):
            self._first_sight(name)
        return self._table(
            {
                (key := keys[name]): (key, x, y, angle, speed, lanes.get(lane, -1), INDICATOR[signals & 3])
                for name, x, y, angle, speed, lane, signals in readings
            }
        )

    @property
    def images(self) -> set[str]:
        """Names in SUMO that stand for something of ours."""
        return self._images

    def obstacles(self) -> Actors:
        """The scenario's static boxes."""
        return self._table({})

    @property
    def keys(self) -> Mapping[str, int]:
        """Key of every actor seen so far, by name."""
        return self._keys

    def _table(self, seen: dict[int, _Row]) -> Actors:
        rows = sorted(seen.values())
        readings = np.fromiter(chain.from_iterable(rows), np.float64, 7 * len(rows))
        (key, kind, lane, indicator), position, (heading, speed, length, width) = _columns(
            readings.reshape(-1, 7), self._obstacles, self._kind, self._length, self._width
        )
        return Actors(key, kind, position, heading, speed, length, width, lane, indicator)

    def _first_sight(self, name: str) -> None:
        domain = libsumo.person if name.startswith("pedestrian") else libsumo.vehicle
        kind = KINDS[domain.getTypeID(name).split("@")[0]]
        self.register(name, kind, domain.getLength(name), domain.getWidth(name))

    def register(self, name: str, kind: ActorKind, length: float, width: float) -> int:
        """Gives an actor its key."""
        key = self._keys[name] = len(self.names)
        self.names.append(name)
        if key == len(self._kind):
            self._kind = np.concatenate([self._kind, np.zeros_like(self._kind)])
            self._length = np.concatenate([self._length, np.zeros_like(self._length)])
            self._width = np.concatenate([self._width, np.zeros_like(self._width)])
        self._kind[key], self._length[key], self._width[key] = kind, length, width
        return key


@njit(cache=True)
def _columns(
    readings: FloatArray, obstacles: FloatArray, kinds: IntArray, lengths: FloatArray, widths: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """The columns of `Actors`: static boxes first, then what SUMO says of the others.

    Args:
        readings: (N, 7) key, x, y [m, SUMO's point of reference], angle [degrees clockwise from north], speed [m/s],
            lane, indicator.
        obstacles: (S, 4) key, x, y [m], heading [rad].
        kinds: ActorKind by key.
        lengths: m, by key.
        widths: m, by key.

    Returns:
        (4, M) key, kind, lane, indicator; (M, 2) position; (4, M) heading, speed, length, width. Few arrays, since each
        one that a kernel returns costs 0.4 us.
    """
    still, count = obstacles.shape[0], obstacles.shape[0] + readings.shape[0]
    names, position, body = np.empty((4, count), dtype=np.int64), np.empty((count, 2)), np.empty((4, count))
    for row in range(count):
        moves = row >= still
        key = int(readings[row - still, 0] if moves else obstacles[row, 0])
        names[0, row], names[1, row], names[2, row], names[3, row] = key, kinds[key], -1, 0
        body[1, row], body[2, row], body[3, row] = 0.0, lengths[key], widths[key]
        if not moves:
            position[row, 0], position[row, 1], body[0, row] = obstacles[row, 1], obstacles[row, 2], obstacles[row, 3]
            continue
        _, x, y, angle, speed, lane, indicator = readings[row - still]
        heading = (1.5 * math.pi - math.radians(angle)) % (2 * math.pi) - math.pi
        # SUMO gives a vehicle's front bumper, a person's centre.
        back = 0.0 if kinds[key] == _PEDESTRIAN else 0.5 * lengths[key]
        position[row, 0], position[row, 1] = x - back * math.cos(heading), y - back * math.sin(heading)
        names[2, row], names[3, row] = int(lane), int(indicator)
        body[0, row], body[1, row] = heading, speed
    return names, position, body
