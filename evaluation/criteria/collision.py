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
from dohyo.sumo_networks.rules.episode_end import reaches
from dohyo.sumo_networks.rules.stop_lines import Point, axis_point
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

    A circle lies around the last counted collision until the ego has left it. A contact that begins inside is left out,
    and counts if it goes on, or is renewed within `same_actor_s`, after the ego has left the circle.

    Attributes:
        standing_mps: An ego slower than this stands: being hit is then no infraction, m/s.
        same_place_m: Radius of the circle, m, between the centres of the ego then and now.
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
    _left_out: dict[int, bool] = field(default_factory=dict, init=False, repr=False)
    _last_hit: Point | None = field(default=None, init=False, repr=False)

    @property
    def touched(self) -> int:
        """Number of distinct actors that the ego ever touched, at fault or not, also while it stood."""
        return len(self._last_contact)

    def update(self, before: World, after: World, ego: int) -> Iterator[Infraction]:
        """Yields one infraction when a contact begins, or when one that was left out outlasts the circle."""
        place, tick_s = axis_point(after.egos, ego, 0.0), after.time - before.time
        speed = max(before.egos.speed.item(ego), after.egos.speed.item(ego))
        if self._last_hit is not None and math.dist(self._last_hit, place) >= self.same_place_m:
            self._last_hit = None
        for contact in after.contacts:
            if contact.ego != ego:
                continue
            key, begins = contact.key, self._begins(contact.key, after.time)
            if begins:
                self._left_out.pop(key, None)
            if speed < self.standing_mps:
                if begins:
                    self._met_standing.add(key)
                continue
            if not begins and key not in self._left_out and not self._drives_into(after, ego, speed, contact, tick_s):
                continue
            self._met_standing.discard(key)
            if self._last_hit is None:
                self._last_hit = place
                yield _collision(after, ego, speed, contact, tick_s, known_fault=self._left_out.pop(key, False))
            elif key not in self._left_out:
                self._left_out[key] = bool(_collision(after, ego, speed, contact, tick_s).at_fault)

    def _begins(self, key: int, time_s: float) -> bool:
        """Whether a contact with an actor is a new one; notes it."""
        last = self._last_contact.get(key)
        self._last_contact[key] = time_s
        return last is None or reaches(time_s - last, self.same_actor_s)

    def _drives_into(self, world: World, ego: int, speed: float, contact: Contact, tick_s: float) -> bool:
        """Whether a contact that began when the ego stood becomes a collision."""
        box, (other, other_speed) = world.egos.box(ego), _other(world, contact)
        return (
            contact.key in self._met_standing
            and approach_mps(box.item(2), speed, other, other_speed) > 0.0
            and hits_with_bumper(box, speed, other, other_speed, tick_s=tick_s)
        )


def _collision(
    world: World, ego: int, speed: float, contact: Contact, tick_s: float, *, known_fault: bool = False
) -> Infraction:
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
        at_fault=known_fault or is_at_fault(box, speed, other, other_speed, tick_s=tick_s, in_one_lane=in_one_lane),
    )


def _other(world: World, contact: Contact) -> tuple[FloatArray, float]:
    """(5,) box of the touched actor or object, and its speed [m/s]."""
    if contact.kind is ActorKind.EGO:
        return world.egos.box(contact.row), world.egos.speed.item(contact.row)
    actors, row = world.actors, contact.row
    return actors.box(row), actors.speed.item(row)
