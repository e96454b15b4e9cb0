"""SUMO proxies: vehicles in SUMO that represent egos and other actors, so that the traffic reacts to them."""

from __future__ import annotations

import math

import libsumo
import numpy as np

from dohyo.sumo_networks.actors.names import approaching
from dohyo.sumo_networks.actors.requests import ShowActor
from dohyo.sumo_networks.arrays import BoolArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.approaches import approach
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.simulation.sumo_frame import ahead_of, angle_of
from dohyo.sumo_networks.simulation.sumo_traffic import is_free
from dohyo.sumo_networks.world import ActorKind

ALIGNED_RAD = 0.6
GRAZED_M = 0.3
APPROACH_LENGTH_M = 1.0
_ANYWHERE = 2  # SUMO's keepRoute: the lane may be off the proxy's route
_NEAR_M = 5.0  # proxies are on a lane already; in a junction, SUMO's default of 100 m costs 80 us, 5 m cost 10 us
_Point = tuple[float, float]


class SumoProxies:
    """All proxies of one simulation.

    Attributes:
        names: Names of the egos' proxies, and of all other proxies that are or were in SUMO.
    """

    def __init__(self, network: RoadNetwork, vehicle: VehicleParameters, egos: tuple[str, ...]) -> None:
        self.names = set(egos)
        self._network, self._vehicle = network, vehicle
        self._anywhere = np.zeros(len(network.lanes.ids), dtype=np.bool_)
        self._routes: set[str] = set()
        self._shown: dict[str, tuple[float, float]] = {}
        self._own_edges: dict[str, BoolArray] = {}

    def add_ego(self, name: str, route: Route) -> None:
        """Adds the route of an ego's proxies to SUMO."""
        libsumo.route.add(name, route.edges)
        libsumo.route.add(approaching(name), route.edges)
        lanes = self._network.lanes
        self._own_edges[name] = np.isin(lanes.edge, lanes.edge[route.on_route])  # those inside junctions, too

    def show_ego(self, name: str, centre: _Point, heading: float, route: Route, behind_m: float = 0.0) -> None:
        """Moves the proxy of an ego to the ego, or `behind_m` behind it; off the road the proxy is hidden."""
        network, vehicle = self._network, self._vehicle
        front = ahead_of(*centre, heading, 0.5 * vehicle.length - behind_m)
        lane, offset, error = network.nearest_lane(*front, heading, route.on_route)
        on_road = lane >= 0 and abs(offset) < 0.5 * (network.lanes.width.item(lane) + vehicle.width)
        if on_road and not self._strayed(name):
            self._move(name, "ego", (vehicle.length, vehicle.width), lane, front, heading)
        else:
            self._remove(name)
        if on_road and not (self._own_edges[name][lane] and abs(error) < 0.5 * math.pi):
            self._show_approach(approaching(name), front, heading, route)
        else:
            self._remove(approaching(name))

    def _show_approach(self, name: str, front: _Point, heading: float, route: Route) -> None:
        """Moves the second proxy of an ego to its route beside it, if a junction is near and the lane is free."""
        place = approach(route, front, heading, inside=name in self._shown)
        if place is None or self._strayed(name) or not is_free(self._network, place, name):
            self._remove(name)
            return
        size = APPROACH_LENGTH_M, self._vehicle.width
        self._move(name, "ego", size, place.lane, (place.x, place.y), place.direction)

    def show_actor(self, actor: ShowActor) -> None:
        """Moves the proxy of an actor to the actor; off the roads, or at an angle to them, it is hidden."""
        network = self._network
        lane, offset, error = network.nearest_lane(actor.x, actor.y, actor.heading, self._anywhere)
        beside = lane < 0 or abs(offset) > 0.5 * (network.lanes.width.item(lane) + actor.width) - GRAZED_M
        turned = actor.across is False and abs(error) > ALIGNED_RAD
        if beside or turned or self._strayed(actor.name):
            self.hide(actor.name)
            return
        if actor.name not in self._routes:
            self._routes.add(actor.name)
            libsumo.route.add(actor.name, actor.edges)
        length, width, heading = actor.length, actor.width, actor.heading
        if actor.across:
            length, width, heading = width, length, heading - error
        elif actor.askew or (actor.across is None and abs(error) > ALIGNED_RAD):
            cos, sin = abs(math.cos(error)), abs(math.sin(error))
            length, width, heading = length * cos + width * sin, length * sin + width * cos, heading - error
        room = network.lanes.width.item(lane) - 2.0 * abs(offset)
        if actor.askew and room < width < room + 2.0 * GRAZED_M:
            width = room  # SUMO stops all traffic in the next lane for a centimetre
        vtype = "emergency" if actor.kind is ActorKind.EMERGENCY else "ego"
        front = ahead_of(actor.x, actor.y, heading, 0.5 * length)
        self._move(actor.name, vtype, (length, width), lane, front, heading)

    def hide(self, name: str) -> None:
        """Removes the proxies of an ego or of another actor, if there are any."""
        self._remove(name)
        if name in self._own_edges:
            self._remove(approaching(name))

    def _remove(self, name: str) -> None:
        """Removes a proxy, if there is one.

        SUMO keeps a vehicle that moveToXY moved off the road in the list of its last lane, and crashes with a
        segmentation fault when another vehicle drives there.
        """
        if name in self._shown:
            del self._shown[name]
            libsumo.vehicle.remove(name)

    def _move(self, name: str, vtype: str, size: tuple[float, float], lane: int, front: _Point, heading: float) -> None:
        place = self._network.edge_id(lane), self._network.lanes.index.item(lane)
        if name not in self._shown:
            self.names.add(name)
            libsumo.vehicle.add(name, name, vtype, departLane="free", departPos="base", departSpeed="0")
            libsumo.vehicle.setSpeedMode(name, 0)
            libsumo.vehicle.setLaneChangeMode(name, 0)
        if self._shown.get(name) != size:
            self._shown[name] = size
            libsumo.vehicle.setLength(name, size[0])
            libsumo.vehicle.setWidth(name, size[1])
        libsumo.vehicle.moveToXY(name, *place, *front, angle_of(heading), _ANYWHERE, _NEAR_M)

    def _strayed(self, name: str) -> bool:
        """Whether SUMO found no lane for a proxy, as may happen past the end of a lane."""
        return name in self._shown and not libsumo.vehicle.getLaneID(name)
