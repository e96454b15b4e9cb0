"""SumoStage: shows the puppets of scripted events to SUMO and to the world, and lets vehicles of theirs in."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import libsumo
import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.events.puppet import Puppet
from dohyo.sumo_networks.events.stage import Entry
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.simulation.registry import Registry
from dohyo.sumo_networks.units import SIGHT_M
from dohyo.sumo_networks.world import ActorKind, Actors, Egos

ALIGNED_RAD = 0.6
GRAZED_M = 0.3
_TRAFFIC = ("vehicle", "bicycle", "flow")


class SumoStage:
    """The simulation as events see it: `events.stage.Stage`."""

    def __init__(self, network: RoadNetwork, registry: Registry, replace: Callable[[Sequence[str]], None]) -> None:
        """Makes an empty stage.

        Args:
            network: The roads.
            registry: Of the same simulation.
            replace: Sends newcomers for vehicles of the traffic that were taken away.
        """
        self._network, self._registry, self._replace = network, registry, replace
        self._anywhere = np.zeros(len(network.lanes.ids), dtype=np.bool_)
        self._routes: set[str] = set()
        self._entered: set[str] = set()

    def note_departures(self) -> None:
        """Learns who entered in the last step."""
        self._entered.update(name for name in libsumo.simulation.getDepartedIDList() if name.startswith("event:"))

    def show(self, puppet: Puppet, edges: tuple[str, ...]) -> None:
        """Moves a puppet's image on the roads, so that the traffic gives way to it; off the roads it has none."""
        network = self._network
        lane, offset, error = network.nearest_lane(puppet.x, puppet.y, puppet.heading, self._anywhere)
        beside = lane < 0 or abs(offset) > 0.5 * (network.lanes.width.item(lane) + puppet.width) - GRAZED_M
        askew = not puppet.across and abs(error) > ALIGNED_RAD
        if beside or askew or self._registry.strayed(puppet.name):
            self._registry.hide_image(puppet.name)
            return
        if puppet.name not in self._routes:
            self._routes.add(puppet.name)
            libsumo.route.add(puppet.name, edges)
        length, width, heading = puppet.length, puppet.width, puppet.heading
        if puppet.across:
            length, width, heading = width, length, heading - error
        front = puppet.x + 0.5 * length * math.cos(heading), puppet.y + 0.5 * length * math.sin(heading)
        vtype = "emergency" if puppet.kind is ActorKind.EMERGENCY else "ego"
        place = network.edge_id(lane), network.lanes.index.item(lane)
        self._registry.move_image(puppet.name, vtype, (length, width), place, front, 90.0 - math.degrees(heading))

    def hide(self, puppet: Puppet) -> None:
        """Takes a puppet's image away."""
        self._registry.hide_image(puppet.name)

    def clear(self, x: float, y: float, radius_m: float) -> None:
        """Takes vehicles of the traffic away that are nearer than this; others come for them elsewhere."""
        cleared = []
        for name in libsumo.vehicle.getIDList():
            if name.startswith(_TRAFFIC) and math.dist(libsumo.vehicle.getPosition(name), (x, y)) < radius_m:
                libsumo.vehicle.remove(name)
                cleared.append(name)
        if cleared:
            self._replace(cleared)

    def vehicles_near(self, x: float, y: float, radius_m: float) -> FloatArray:
        """(M, 6) x, y [m], heading [rad], length, width [m], speed [m/s] of vehicles near a point, egos included."""
        rows, domain = [], libsumo.vehicle
        for name in domain.getIDList():
            px, py = domain.getPosition(name)
            if math.dist((px, py), (x, y)) > radius_m or name.startswith("jaywalker"):
                continue
            heading = (1.5 * math.pi - math.radians(domain.getAngle(name))) % (2 * math.pi) - math.pi
            length = domain.getLength(name)
            px, py = px - 0.5 * length * math.cos(heading), py - 0.5 * length * math.sin(heading)
            rows.append((px, py, heading, length, domain.getWidth(name), domain.getSpeed(name)))
        return np.array(rows, dtype=np.float64).reshape(-1, 6)

    def enter(self, name: str, entry: Entry) -> None:
        """Lets a vehicle enter as soon as there is room."""
        libsumo.route.add(name, entry.edges)
        # A speed as a number would be an error of SUMO's where it is too fast for a light ahead.
        libsumo.vehicle.add(name, name, entry.type, "now", str(entry.lane), str(entry.position_m), "desired")
        if entry.max_speed_mps is not None:
            libsumo.vehicle.setMaxSpeed(name, entry.max_speed_mps)

    def entered(self, name: str) -> bool:
        """Whether a vehicle is on the road, or has been."""
        return name in self._entered

    def withdraw(self, name: str) -> None:
        """Takes a vehicle away if it is still waiting for room."""
        if name in libsumo.simulation.getPendingVehicles():
            libsumo.vehicle.remove(name)

    def with_cast(self, actors: Actors, cast: Sequence[Puppet], egos: Egos) -> Actors:
        """The actors and those puppets that an ego is near enough to see, in the order of keys."""
        if not cast:
            return actors
        viewpoints = egos.position[egos.active].tolist()
        seen = [one for one in cast if any(one.distance(x, y) <= SIGHT_M for x, y in viewpoints)]
        if not seen:
            return actors
        table = Actors(
            key=np.concatenate([actors.key, [self._key(one) for one in seen]]),
            kind=np.concatenate([actors.kind, [int(one.kind) for one in seen]]),
            position=np.concatenate([actors.position, [(one.x, one.y) for one in seen]]),
            heading=_joined(actors.heading, [math.remainder(one.heading, 2 * math.pi) for one in seen]),
            speed=_joined(actors.speed, [math.hypot(one.speed, one.drift) for one in seen]),
            length=_joined(actors.length, [one.length for one in seen]),
            width=_joined(actors.width, [one.width for one in seen]),
            lane=np.concatenate([actors.lane, [self._lane(one) for one in seen]]),
            indicator=np.concatenate([actors.indicator, [one.indicator or int(np.sign(one.drift)) for one in seen]]),
        )
        return table.take(np.argsort(table.key, kind="stable"))

    def _key(self, puppet: Puppet) -> int:
        key = self._registry.keys.get(puppet.name)
        if key is None:
            key = self._registry.register(puppet.name, puppet.kind, puppet.length, puppet.width)
        return key

    def _lane(self, puppet: Puppet) -> int:
        lane, offset, _ = self._network.nearest_lane(puppet.x, puppet.y, puppet.heading, self._anywhere)
        return lane if lane >= 0 and abs(offset) <= 0.5 * self._network.lanes.width[lane] else -1


def _joined(column: FloatArray, more: Sequence[float]) -> FloatArray:
    return np.concatenate([column, np.array(more, dtype=np.float64)])
