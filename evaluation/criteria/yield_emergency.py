"""Yield to emergency vehicles: the ego has not let an emergency vehicle pass."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from dohyo.evaluation.criteria.base import Criterion, infraction
from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.world import EventPhase, EventState, World

EMERGENCY = "yield_to_emergency_vehicle"


@dataclass(slots=True)
class YieldEmergency(Criterion):
    """Detects an ego that is still ahead of the emergency vehicle when the event ends, once per event.

    An event that still runs when the ego's episode ends is judged then. The size is the distance along the route from
    the centre of the emergency vehicle to the centre of the ego.

    Source: CARLA Leaderboard 2.1, YieldToEmergencyVehicleTest.
    """

    kinds: ClassVar[tuple[InfractionKind, ...]] = (InfractionKind.YIELD_EMERGENCY,)

    def update(self, before: World, after: World, ego: int) -> Iterator[Infraction]:
        """Yields one infraction for each emergency vehicle that has not passed the ego."""
        for earlier, event in zip(before.events, after.events, strict=True):
            ended = event.phase in (EventPhase.DONE, EventPhase.TIMED_OUT) and earlier.phase is EventPhase.ACTIVE
            if ended:
                yield from _judge(event, after, ego)

    def finish(self, world: World, ego: int) -> Iterator[Infraction]:
        """Yields one infraction for each emergency vehicle that is still behind the ego."""
        for event in world.events:
            if event.phase is EventPhase.ACTIVE:
                yield from _judge(event, world, ego)


def _judge(event: EventState, world: World, ego: int) -> Iterator[Infraction]:
    if event.ego == ego and event.kind == EMERGENCY and event.ahead < 0.0:
        name = world.name_of(event.actors[0]) if event.actors else event.name
        yield infraction(InfractionKind.YIELD_EMERGENCY, world, ego, -event.ahead, actor=name)
