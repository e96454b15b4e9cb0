"""Collision: the ego's box touches another one; whose fault it was by nuPlan's tests."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from dohyo.evaluation.criteria.base import Criterion, axis_point, infraction
from dohyo.evaluation.records.record import Infraction, InfractionKind
from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.geometry import boxes_overlap
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.world import ActorKind, Contact, World

STOPPED_MPS = 0.05
BEHIND_RAD = math.radians(150.0)
BESIDE_LANE_M = 0.5
_CONNECTED_HOPS = 3
_KINDS = {
    ActorKind.PEDESTRIAN: InfractionKind.COLLISION_PEDESTRIAN,
    ActorKind.STATIC: InfractionKind.COLLISION_STATIC,
}


@dataclass(slots=True)
class Collision(Criterion):
    """Detects collisions, and remembers everything that was ever touched.

    The ego's speed is the faster of those before and after the tick: an ego that brakes to a stop in the tick of the
    impact was moving.

    Attributes:
        standing_mps: A slower ego was hit and did not hit, m/s.
        same_place_m: Contacts nearer than this to the last counted hit belong to it, m.
        same_actor_s: Contacts with an actor sooner than this after the last one with it belong to that one, s.

    Source: CARLA Leaderboard 2.1, CollisionTest; at fault: nuPlan, no ego at-fault collision.
    """

    standing_mps: float = 0.1
    same_place_m: float = 5.0
    same_actor_s: float = 5.0
    _last_contact: dict[int, float] = field(default_factory=dict, init=False, repr=False)
    _last_hit: tuple[float, float] | None = field(default=None, init=False, repr=False)

    @property
    def touched(self) -> int:
        """Number of distinct actors ever touched, at fault or not, those that hit a standing ego included."""
        return len(self._last_contact)

    def update(self, before: World, after: World, ego: int) -> Iterator[Infraction]:
        """Yields one infraction when a contact begins."""
        for contact in after.contacts:
            if contact.ego != ego:
                continue
            last = self._last_contact.get(contact.key)
            self._last_contact[contact.key] = after.time
            if last is not None and after.time - last < self.same_actor_s:
                continue
            speed = max(before.egos.speed.item(ego), after.egos.speed.item(ego))
            if speed < self.standing_mps or self._near_last_hit(after, ego):
                continue
            self._last_hit = axis_point(after.egos, ego, 0.0)
            yield _collision(after, ego, speed, contact, after.time - before.time)

    def _near_last_hit(self, world: World, ego: int) -> bool:
        return (
            self._last_hit is not None
            and math.dist(self._last_hit, axis_point(world.egos, ego, 0.0)) < self.same_place_m
        )


def _collision(world: World, ego: int, speed: float, contact: Contact, tick_s: float) -> Infraction:
    other, other_speed = _other(world, contact)
    heading = world.egos.heading.item(ego)
    closing = math.hypot(
        speed * math.cos(heading) - other_speed * math.cos(other[2]),
        speed * math.sin(heading) - other_speed * math.sin(other[2]),
    )
    return infraction(
        _KINDS.get(contact.kind, InfractionKind.COLLISION_VEHICLE),
        world,
        ego,
        closing,
        "m/s",
        actor=world.name_of(contact.key),
        at_fault=is_at_fault(world, ego, speed, other, other_speed, tick_s),
    )


def _other(world: World, contact: Contact) -> tuple[FloatArray, float]:
    """(5,) box and speed [m/s] of what was touched."""
    if contact.kind is ActorKind.EGO:
        return world.egos.box(contact.row), world.egos.speed.item(contact.row)
    actors, row = world.actors, contact.row
    box = np.array([*actors.position[row], actors.heading[row], actors.length[row], actors.width[row]])
    return box, actors.speed.item(row)


def is_at_fault(world: World, ego: int, speed: float, other: FloatArray, other_speed: float, tick_s: float) -> bool:
    """Whether the ego caused a collision.

    In this order: a stopped ego did not; an ego that meets something stopped did; a hit from behind is the other's; one
    with the ego's front bumper is the ego's; any other is lateral, and the ego's unless it keeps to one lane.

    Args:
        world: The world in which the two boxes touch.
        ego: Index of the ego.
        speed: Of the ego, m/s.
        other: (5,) the other box: x, y [m], heading [rad], length, width [m].
        other_speed: m/s; 0 for static things.
        tick_s: Time since the world in which they did not touch yet, s.

    Source: nuPlan, no ego at-fault collision. Its bearing starts at the rear axle, this one at the box's centre; its
    bumper is where it is after the tick, this one is swept over the tick, as seen from the other: a car at 30 km/h
    would otherwise pass through a pedestrian's front to meet him with its side.
    """
    if speed <= STOPPED_MPS:
        return False
    if other_speed <= STOPPED_MPS:
        return True
    x, y, heading, length, width = world.egos.box(ego).tolist()
    bearing = math.atan2(other[1] - y, other[0] - x) - heading
    if math.cos(bearing) < math.cos(BEHIND_RAD):
        return False
    swept = max(speed - other_speed * math.cos(other[2] - heading), 0.0) * tick_s
    bumper = np.array([[*axis_point(world.egos, ego, (length - swept) / 2), heading, swept, width]])
    if boxes_overlap(bumper, other[None])[0, 0]:
        return True
    return not keeps_to_one_lane(world, ego)


def keeps_to_one_lane(world: World, ego: int) -> bool:
    """Whether the four corners of an ego are on its centre's lane, or on lanes that lead into or out of it."""
    network, egos = world.network, world.egos
    if egos.lane[ego] < 0:
        return False
    own = _connected(network, egos.lane.item(ego))
    heading, half = egos.heading.item(ego), 0.5 * egos.length.item(ego)
    left_x, left_y = -0.5 * egos.width.item(ego) * math.sin(heading), 0.5 * egos.width.item(ego) * math.cos(heading)
    for ahead, side in product((half, -half), (1.0, -1.0)):
        x, y = axis_point(egos, ego, ahead)
        # Of the lanes that overlap inside a junction, a corner is on the ego's own if it can be.
        lane, offset, _ = network.nearest_lane(x + side * left_x, y + side * left_y, heading, own)
        if lane < 0 or not own[lane] or abs(offset) > 0.5 * network.lanes.width[lane] + BESIDE_LANE_M:
            return False
    return True


def _connected(network: RoadNetwork, lane: int) -> BoolArray:
    """(L,) the lane, those it leads to, and those that lead to it, within about a vehicle's length."""
    source, target = network.connections.source, network.connections.target
    following = np.zeros(len(network.lanes.ids), dtype=np.bool_)
    following[lane] = True
    leading = following.copy()
    for _ in range(_CONNECTED_HOPS):
        following[target[following[source]]] = True
        leading[source[leading[target]]] = True
    return following | leading
