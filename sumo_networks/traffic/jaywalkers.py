"""Jaywalkers: people who walk up and down a street, and cross it where there is no crossing.

They walk at walking speed, never jump, and look before they step off the kerb. Some accept a short gap, so that a
driver must brake for them. The traffic reacts to their SUMO proxies, as to those of other scripted actors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import lru_cache

import numpy as np

from dohyo.sumo_networks.actors.names import Role, numbered, predicted
from dohyo.sumo_networks.actors.paths import ActorPath
from dohyo.sumo_networks.actors.requests import HideActor, Request, ShowActor
from dohyo.sumo_networks.actors.scripted_actor import ScriptedActor
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.geometry import boxes_overlap
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.world import ActorKind

END_M = 20.0  # jaywalkers keep this distance from a street's ends, where the junctions' crossings are
WIDEST_M = 35.0
LOOK_M = 80.0
LOOK_EVERY = 5  # ticks between two looks for a gap
PATIENCE_S = 20.0
FORESIGHT_S = 2.0
ROOM_M = 3.0  # free distance between a jaywalker and a passing vehicle
STANDING_MPS = 0.5
_SIZE_M = 0.5
VehiclesNear = Callable[[float, float, float], FloatArray]
"""Query: (M, 6) x, y [m], heading [rad], length, width [m], speed [m/s] of vehicles within a radius [m] of x, y [m]."""


@dataclass(frozen=True, slots=True)
class Street:
    """A stretch of road between two junctions, with a sidewalk on either side.

    Attributes:
        sidewalk: Centreline of the right sidewalk.
        across_m: Distance to the left to the middle of the left sidewalk, m.
    """

    sidewalk: ActorPath
    across_m: float


class _Doing(Enum):
    WALKING = auto()
    LOOKING = auto()
    CROSSING = auto()


@dataclass(slots=True)
class _Jaywalker:
    """One jaywalker.

    Attributes:
        actor: Actor in the world.
        forecast: Predicted actor in 2 s.
        street: Street to walk along and to cross.
        speed_mps: Walking speed, m/s.
        caution: Share of the crossing time that must be free of vehicles; below 1 others must brake.
        at_m: Position along the street, or the position to walk to, m.
        left: Whether the jaywalker is on the left side of the street.
        doing: Current activity.
        patience_s: Remaining time to look for a gap, s.
    """

    actor: ScriptedActor
    forecast: ScriptedActor
    street: Street
    speed_mps: float
    caution: float
    at_m: float
    left: bool
    doing: _Doing = _Doing.WALKING
    patience_s: float = field(default=0.0)


class Jaywalkers:
    """All jaywalkers of a scenario; their number is constant.

    Attributes:
        actors: Actors in the world, one per jaywalker.
    """

    def __init__(self, network: RoadNetwork, count: int, rng: np.random.Generator) -> None:
        """Places the jaywalkers on the sidewalks of random streets, more often of long ones.

        Raises:
            InvalidInputError: The network has no street to cross.
        """
        self._rng, self._tick = rng, 0
        self._people = [self._person(number, streets(network)) for number in range(count)]
        self.actors = [one.actor for one in self._people]

    def update(self, seconds: float, vehicles_near: VehiclesNear, edges: tuple[str, ...]) -> Iterator[Request]:
        """Advances one tick; yields requests that move the SUMO proxies.

        Args:
            seconds: Length of the tick.
            vehicles_near: Query for SUMO's vehicles near a point, egos included and jaywalkers excluded.
            edges: Any route of the network, since SUMO requires one for every proxy.
        """
        self._tick += 1
        for number, one in enumerate(self._people):
            actor = one.actor
            if one.doing is _Doing.LOOKING:
                one.patience_s -= seconds
                if (self._tick + number) % LOOK_EVERY == 0:
                    self._look(one, vehicles_near)
            elif actor.s >= actor.path.length:
                yield from self._arrive(one)
            elif one.doing is _Doing.CROSSING:
                actor.speed = 0.0 if _would_hit_standing_vehicle(actor, vehicles_near) else one.speed_mps
            actor.s = min(actor.s + actor.speed * seconds, actor.path.length)
            actor.pose()
            if one.doing is _Doing.CROSSING:
                yield from self._show(one, edges)

    def _show(self, one: _Jaywalker, edges: tuple[str, ...]) -> Iterator[Request]:
        """Shows two proxies, at the current and the predicted place, so that drivers on the far side brake in time."""
        yield ShowActor.of(one.actor, edges)
        ahead, forecast = one.actor.s + FORESIGHT_S * one.speed_mps, one.forecast
        forecast.path, forecast.s = one.actor.path, min(ahead, one.actor.path.length)
        forecast.pose()
        yield ShowActor.of(forecast, edges)

    def _person(self, number: int, found: Sequence[Street]) -> _Jaywalker:
        rng = self._rng
        length = np.array([street.sidewalk.length for street in found])
        street = found[int(rng.choice(len(found), p=length / length.sum()))]
        speed = float(np.clip(rng.normal(1.35, 0.2), 0.8, 2.0))
        caution, left = float(rng.uniform(0.6, 1.4)), bool(rng.random() < 0.5)
        at = self._somewhere(street)
        way = _along(street, at, at + 1.0, left)
        name, body = numbered(Role.JAYWALKER, number), (ActorKind.PEDESTRIAN, _SIZE_M, _SIZE_M)
        actor = ScriptedActor(name, *body, way, 0.0, present=True)
        forecast = ScriptedActor(predicted(name), *body, way, 0.0, across=True)
        one = _Jaywalker(actor, forecast, street, speed, caution, at, left)
        self._walk_on(one)
        return one

    def _somewhere(self, street: Street) -> float:
        return float(self._rng.uniform(END_M, street.sidewalk.length - END_M))

    def _walk_on(self, one: _Jaywalker) -> None:
        """Walks along the current side of the street."""
        here, one.at_m = one.at_m, self._somewhere(one.street)
        one.doing, one.actor.across = _Doing.WALKING, False
        _set_out(one, _along(one.street, here, one.at_m, one.left))

    def _arrive(self, one: _Jaywalker) -> Iterator[Request]:
        if one.doing is _Doing.CROSSING:
            one.left = not one.left
            yield HideActor(one.actor.name)
            yield HideActor(one.forecast.name)
            self._walk_on(one)
        else:
            one.doing, one.actor.speed = _Doing.LOOKING, 0.0
            one.patience_s = float(self._rng.exponential(PATIENCE_S))

    def _look(self, one: _Jaywalker, vehicles_near: VehiclesNear) -> None:
        """Begins to cross if the road is free for long enough; walks on when the patience is used up."""
        way = _across(one.street, one.at_m, one.left)
        x, y, heading = way.at(0.5 * way.length)
        vehicles = vehicles_near(x, y, LOOK_M)
        if is_free(vehicles, (x, y, heading), 0.5 * way.length, one.caution * way.length / one.speed_mps):
            one.doing, one.actor.across = _Doing.CROSSING, True
            _set_out(one, way)
        elif one.patience_s <= 0.0:
            self._walk_on(one)


def is_free(vehicles: FloatArray, middle: tuple[float, float, float], half_m: float, seconds: float) -> bool:
    """Whether no vehicle will be on a line across the road for a time.

    Args:
        vehicles: (M, 6) x, y [m], heading [rad], length, width [m], speed [m/s].
        middle: x, y [m] of the line's middle, and its direction [rad].
        half_m: Half of the line's length, m.
        seconds: Length of the time, s.
    """
    x, y, direction = middle
    cos, sin = math.cos(direction), math.sin(direction)
    for px, py, heading, length, width, speed in vehicles.tolist():
        dx, dy, room = x - px, y - py, 0.5 * length + ROOM_M
        along_line, from_line, distance = dx * cos + dy * sin, dx * sin - dy * cos, math.hypot(dx, dy)
        if abs(along_line) <= half_m + 0.5 * width and abs(from_line) <= room:
            return False
        comes = speed * (dx * math.cos(heading) + dy * math.sin(heading)) / max(distance, 0.1)
        if comes > STANDING_MPS and max(distance - half_m - room, 0.0) / comes < seconds:
            return False
    return True


@lru_cache(maxsize=16)
def streets(network: RoadNetwork) -> tuple[Street, ...]:
    """The streets of a network that can be crossed on foot between its junctions.

    Raises:
        InvalidInputError: The network has no such street.
    """
    lanes = network.lanes
    sidewalk = lanes.pedestrian & ~lanes.drivable & ~lanes.internal & ~lanes.crossing & (lanes.length > 3 * END_M)
    sidewalk &= np.array([not str(edge).startswith(":") for edge in lanes.edge_ids])[lanes.edge]
    found = [_street(network, int(lane), sidewalk.__getitem__) for lane in np.flatnonzero(sidewalk)]
    out = tuple(street for street in found if street is not None)
    if not out:
        raise InvalidInputError(
            f"traffic.jaywalkers: network '{network.name}' has no street of {3 * END_M:g} m with two sidewalks"
        )
    return out


def _street(network: RoadNetwork, lane: int, is_sidewalk: Callable[[int], np.bool_]) -> Street | None:
    """Street whose right sidewalk is a lane; None without a left sidewalk at a constant distance."""
    lanes = network.lanes
    path = ActorPath(network.lane_shape(lane))
    if path.length <= 3 * END_M:
        return None
    own = network.lanes_of_edge[network.edge_id(lane)]
    edge_m = 0.5 * lanes.width.item(lane) + sum(lanes.width.item(one) for one in own if one != lane)
    x, y, heading = path.at(0.5 * path.length, edge_m + 1.5)
    oncoming, _, error = network.nearest_lane(x, y, heading + math.pi, np.zeros(len(lanes.ids), dtype=np.bool_))
    if oncoming < 0 or abs(error) > 0.3:
        return None
    beyond = network.lanes_of_edge[network.edge_id(oncoming)]
    other = next((one for one in beyond if is_sidewalk(one)), -1)
    across = edge_m + sum(lanes.width.item(one) for one in beyond if one != other) + 0.5 * lanes.width.item(other)
    if other < 0 or across > WIDEST_M or not lanes.drivable[own].any():
        return None
    opposite = ActorPath(network.lane_shape(other)).points
    ends = [path.at(s, across)[:2] for s in (END_M, 0.5 * path.length, path.length - END_M)]
    parallel = all(np.hypot(*(opposite - end).T).min() < 1.0 for end in ends)
    return Street(path, across) if parallel else None


def _along(street: Street, start_m: float, end_m: float, left: bool) -> ActorPath:
    """Path along one side of a street."""
    stops = np.linspace(start_m, end_m, max(round(abs(end_m - start_m)), 1) + 1)
    return ActorPath(np.array([street.sidewalk.at(s, street.across_m * left)[:2] for s in stops.tolist()]))


def _across(street: Street, at_m: float, from_left: bool) -> ActorPath:
    """Path straight across a street."""
    sides = (street.across_m, 0.0) if from_left else (0.0, street.across_m)
    return ActorPath(np.array([street.sidewalk.at(at_m, side)[:2] for side in sides]))


def _set_out(one: _Jaywalker, way: ActorPath) -> None:
    actor = one.actor
    actor.path, actor.s, actor.speed = way, 0.0, one.speed_mps
    actor.pose()


def _would_hit_standing_vehicle(actor: ScriptedActor, vehicles_near: VehiclesNear) -> bool:
    """Whether the next step would hit a standing vehicle."""
    vehicles = vehicles_near(actor.x, actor.y, 15.0)
    standing = vehicles[vehicles[:, 5] < STANDING_MPS]
    x, y, heading, length, width = actor.box
    ahead = (x + 0.5 * math.cos(heading), y + 0.5 * math.sin(heading), heading, length + 1.0, width)
    return bool(boxes_overlap(np.array([ahead]), standing[:, :5]).any())
