"""Survey: all actors along the egos' routes, seen or not, so that a log also fits an ego that drives slower."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import libsumo
import numpy as np

from dohyo.sumo_networks.actors.names import Role, numbered
from dohyo.sumo_networks.actors.scripted_actor import ScriptedActor
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.simulation.registry import INDICATOR, KINDS
from dohyo.sumo_networks.simulation.scripted_actors import lane_under
from dohyo.sumo_networks.simulation.sumo_frame import ahead_of, heading_of
from dohyo.sumo_networks.units import SIGHT_M
from dohyo.sumo_networks.world import ActorKind, Actors

SPACING_M = 40
_SLACK_M = 30.0
_Row = tuple[str, int, float, float, float, float, float, float, int, int]


class Survey:
    """Reader of all actors within sight of any point that an ego can reach on its route.

    Attributes:
        network: The road network.
        points: (P, 2), m, points that egos can reach; None: the whole network.
    """

    def __init__(self, network: RoadNetwork, points: FloatArray | None) -> None:
        """Prepares a survey around (P, 2) points [m], or of the whole network."""
        self.network, self.points = network, points
        self._lanes: Mapping[str, int] = network.lane_index
        self._anywhere = np.zeros(len(network.lanes.ids), dtype=np.bool_)
        self._bodies: dict[str, tuple[int, float, float]] = {}

    def read(self, proxies: set[str], scripted: Sequence[ScriptedActor], obstacles: Actors) -> tuple[list[str], Actors]:
        """Reads names and states; keys are row numbers.

        Args:
            proxies: Names of the SUMO proxies of egos and scripted actors, which are left out.
            scripted: The scripted actors.
            obstacles: Static boxes, which are not in SUMO.
        """
        rows = [
            (numbered(Role.OBSTACLE, i), int(obstacles.kind[i]), x, y, heading, 0.0, length, width, -1, 0)
            for i, (x, y, heading, length, width) in enumerate(obstacles.boxes().tolist())
        ]
        found: list[_Row] = [*rows, *(self._scripted_row(one) for one in scripted if self._near(one.x, one.y))]
        for domain, signals in ((libsumo.vehicle, libsumo.vehicle.getSignals), (libsumo.person, lambda _: 0)):
            for name in domain.getIDList():
                x, y = domain.getPosition(name)
                if name not in proxies and self._near(x, y):
                    found.append(self._row(domain, name, x, y, signals(name)))
        return [row[0] for row in found], _table(found)

    def _near(self, x: float, y: float) -> bool:
        return self.points is None or bool(
            np.hypot(self.points[:, 0] - x, self.points[:, 1] - y).min() <= SIGHT_M + _SLACK_M
        )

    def _row(self, domain: type[libsumo.vehicle], name: str, x: float, y: float, signals: int) -> _Row:
        if name not in self._bodies:
            known = int(KINDS[domain.getTypeID(name).split("@")[0]])
            self._bodies[name] = known, domain.getLength(name), domain.getWidth(name)
        kind, length, width = self._bodies[name]
        heading = heading_of(domain.getAngle(name))
        back = 0.0 if kind == ActorKind.PEDESTRIAN else 0.5 * length  # SUMO's position is the front bumper
        x, y = ahead_of(x, y, heading, -back)
        lane = self._lanes.get(domain.getLaneID(name), -1)
        return name, kind, x, y, heading, domain.getSpeed(name), length, width, lane, INDICATOR[signals & 3]

    def _scripted_row(self, one: ScriptedActor) -> _Row:
        heading, speed = math.remainder(one.heading, 2 * math.pi), math.hypot(one.speed, one.drift)
        place = lane_under(one, self.network, self._anywhere), one.indicator or int(np.sign(one.drift))
        return one.name, int(one.kind), one.x, one.y, heading, speed, one.length, one.width, *place


def reachable(routes: Sequence[Route], ahead_m: float) -> FloatArray:
    """(P, 2) points [m] every 40 m of the routes, as far as an ego can drive."""
    reach = [route.position[: math.ceil(ahead_m) + SPACING_M] for route in routes]
    return np.concatenate([np.concatenate([path[::SPACING_M], path[-1:]]) for path in reach])


def _table(rows: Sequence[_Row]) -> Actors:
    columns = list(zip(*rows, strict=True)) if rows else [()] * 10
    numbers = [np.array(column, dtype=np.float64) for column in columns[2:8]]
    x, y, heading, speed, length, width = numbers
    kind, lane, indicator = (np.array(columns[i], dtype=np.int64) for i in (1, 8, 9))
    keys = np.arange(len(rows))
    return Actors(keys, kind, np.column_stack([x, y]), heading, speed, length, width, lane, indicator)
