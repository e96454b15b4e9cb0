"""Collision: the ego's box touches the box of another actor or object."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

from dohyo.evaluation.criteria.base import Criterion, infraction
from dohyo.evaluation.criteria.fault import approach_mps, hits_with_bumper, is_at_fault, keeps_to_one_lane
from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.rules.stop_lines import axis_point
from dohyo.sumo_networks.world import ActorKind, Contact, World

_KINDS = {
    ActorKind.PEDESTRIAN: InfractionKind.COLLISION_PEDESTRIAN,
    ActorKind.STATIC: InfractionKind.COLLISION_STATIC,
}


@dataclass(slots=True)
class Collision(Criterion):
    """Detects collisions, and counts the actors that the ego ever touched.

    The ego's speed is the faster of those before and after the tick: an ego that brakes to a stop in the tick of the
    impact was moving. Who touched the standing ego is hit by it once it drives into him with its bumper.

    Attributes:
        standing_mps: An ego slower than this stands: being hit is then no infraction, m/s.
        same_place_m: A contact nearer than this to the last counted collision belongs to it, m.
        same_actor_s: A contact sooner than this after the last one with the same actor belongs to that one, s.

    Source: CARLA Leaderboard 2.1, CollisionTest; at fault: nuPlan, no ego at-fault collision.
    """

    kinds: ClassVar[tuple[InfractionKind, ...]] = (
        InfractionKind.COLLISION_PEDESTRIAN,
        InfractionKind.COLLISION_VEHICLE,
        InfractionKind.COLLISION_STATIC,
    )

    standing_mps: float = 0.1
    same_place_m: float = 5.0
    same_actor_s: float = 5.0
    _last_contact: dict[int, float] = field(default_factory=dict, init=False, repr=False)
    _met_standing: set[int] = field(default_factory=set, init=False, repr=False)
    _last_hit: tuple[float, float] | None = field(default=None, init=False, repr=False)

    @property
    def touched(self) -> int:
        """Number of distinct actors that the ego ever touched, at fault or not, also while it stood."""
        return len(self._last_contact)

    def update(self, before: World, after: World, ego: int) -> Iterator[Infraction]:
        """Yields one infraction when a contact begins."""
        for contact in after.contacts:
            if contact.ego != ego:
                continue
            last = self._last_contact.get(contact.key)
            self._last_contact[contact.key] = after.time
            begins = last is None or after.time - last >= self.same_actor_s
            speed = max(before.egos.speed.item(ego), after.egos.speed.item(ego))
            if speed < self.standing_mps:
                if begins:
                    self._met_standing.add(contact.key)
                continue
            tick_s = after.time - before.time
            if not begins and not self._drives_into(after, ego, speed, contact, tick_s):
                continue
            self._met_standing.discard(contact.key)
            if self._near_last_hit(after, ego):
                continue
            self._last_hit = axis_point(after.egos, ego, 0.0)
            yield _collision(after, ego, speed, contact, tick_s)

    def _drives_into(self, world: World, ego: int, speed: float, contact: Contact, tick_s: float) -> bool:
        """Whether a contact that began when the ego stood becomes a collision."""
        box, (other, other_speed) = world.egos.box(ego), _other(world, contact)
        return (
            contact.key in self._met_standing
            and approach_mps(box.item(2), speed, other, other_speed) > 0.0
            and hits_with_bumper(box, speed, other, other_speed, tick_s=tick_s)
        )

    def _near_last_hit(self, world: World, ego: int) -> bool:
        return (
            self._last_hit is not None
            and math.dist(self._last_hit, axis_point(world.egos, ego, 0.0)) < self.same_place_m
        )


def _collision(world: World, ego: int, speed: float, contact: Contact, tick_s: float) -> Infraction:
    other, other_speed = _other(world, contact)
    box, heading = world.egos.box(ego), world.egos.heading.item(ego)
    in_one_lane = keeps_to_one_lane(world.network, box, world.egos.lane.item(ego))
    closing = math.hypot(
        speed * math.cos(heading) - other_speed * math.cos(other[2]),
        speed * math.sin(heading) - other_speed * math.sin(other[2]),
    )
    return infraction(
        _KINDS.get(contact.kind, InfractionKind.COLLISION_VEHICLE),
        world,
        ego,
        closing,
        actor=world.name_of(contact.key),
        at_fault=is_at_fault(box, speed, other, other_speed, tick_s=tick_s, in_one_lane=in_one_lane),
    )


def _other(world: World, contact: Contact) -> tuple[FloatArray, float]:
    """(5,) box of the touched actor or object, and its speed [m/s]."""
    if contact.kind is ActorKind.EGO:
        return world.egos.box(contact.row), world.egos.speed.item(contact.row)
    actors, row = world.actors, contact.row
    return actors.box(row), actors.speed.item(row)
