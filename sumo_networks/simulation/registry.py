"""ActorRegistry: names, kinds and boxes of all actors seen in SUMO, by key."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import chain

import libsumo
import numpy as np
from numba import njit

from dohyo.sumo_networks.actors.names import Role, numbered, role_of
from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.scenario import Obstacle
from dohyo.sumo_networks.simulation.sumo_frame import ahead_of, heading_of
from dohyo.sumo_networks.simulation.surroundings import Reading
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
INDICATOR = {0: 0, 1: -1, 2: 1, 3: 0}  # SUMO's lowest two bits: right, left
_Row = tuple[int, float, float, float, float, int, int]  # key, x, y, angle, speed, lane, indicator


class ActorRegistry:
    """All actors seen so far; an actor's key is its row in the registry.

    Attributes:
        names: Names by key.
    """

    def __init__(self, network: RoadNetwork, obstacles: Sequence[Obstacle]) -> None:
        """Registers the static boxes of a scenario."""
        self.names: list[str] = []
        self._lane_index = network.lane_index
        self._keys: dict[str, int] = {}
        self._kind: IntArray = np.zeros(256, dtype=np.int64)
        self._length: FloatArray = np.zeros(256)
        self._width: FloatArray = np.zeros(256)
        self._obstacles = np.array(
            [
                (self._register_obstacle(i, one), one.x_m, one.y_m, math.remainder(one.heading_rad, math.tau))
                for i, one in enumerate(obstacles)
            ]
        ).reshape(-1, 4)

    def read(self, readings: Sequence[Reading]) -> Actors:
        """Table of the static boxes and of the actors in readings, in the order of keys."""
        keys, lanes = self._keys, self._lane_index
        for name in sorted({reading[0] for reading in readings if reading[0] not in keys}):
            self._register_from_sumo(name)
        return self._table(
            {
                (key := keys[name]): (key, x, y, angle, speed, lanes.get(lane, -1), INDICATOR[signals & 3])
                for name, x, y, angle, speed, lane, signals in readings
            }
        )

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

    def _register_obstacle(self, number: int, obstacle: Obstacle) -> int:
        name = numbered(Role.OBSTACLE, number)
        return self.register(name, ActorKind.STATIC, obstacle.length_m, obstacle.width_m)

    def _register_from_sumo(self, name: str) -> None:
        domain = libsumo.person if role_of(name) is Role.PEDESTRIAN else libsumo.vehicle
        kind = KINDS[domain.getTypeID(name).split("@")[0]]
        self.register(name, kind, domain.getLength(name), domain.getWidth(name))

    def register(self, name: str, kind: ActorKind, length: float, width: float) -> int:
        """Registers an actor and returns its key."""
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
    """Columns of `Actors`: static boxes first, then SUMO's actors.

    Args:
        readings: (N, 7) key, x, y [m, SUMO's point of reference], angle [degrees clockwise from north], speed [m/s],
            lane, indicator.
        obstacles: (S, 4) key, x, y [m], heading [rad].
        kinds: ActorKind by key.
        lengths: Lengths by key, m.
        widths: Widths by key, m.

    Returns:
        (4, M) key, kind, lane, indicator; (M, 2) position; (4, M) heading, speed, length, width. Few arrays, since each
        array that a kernel returns costs 0.4 us.
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
        heading = heading_of(angle)
        # SUMO's position is the front bumper of a vehicle, but the centre of a person.
        back = 0.0 if kinds[key] == _PEDESTRIAN else 0.5 * lengths[key]
        position[row, 0], position[row, 1] = ahead_of(x, y, heading, -back)
        names[2, row], names[3, row] = int(lane), int(indicator)
        body[0, row], body[1, row] = heading, speed
    return names, position, body
