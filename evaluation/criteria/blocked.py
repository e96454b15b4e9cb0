"""Blocked: the ego has stood still for too long, by its own fault or in a gridlock of the simulation."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from dohyo.evaluation.criteria.base import Criterion, infraction
from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.geometry import wrap
from dohyo.sumo_networks.rules.episode_end import exceeds, reaches
from dohyo.sumo_networks.units import SIGHT_M
from dohyo.sumo_networks.world import ActorKind, World

WATCH_S = 1.0
MOVING_MPS = 0.5
JAMMED_S = 120.0
QUEUE_GAP_M, TOUCHING_M = 8.0, 0.5
SAME_DIRECTION_RAD = math.radians(45.0)
_QUEUEING = (ActorKind.CAR, ActorKind.VAN, ActorKind.TRUCK, ActorKind.BUS, ActorKind.BICYCLE)


@dataclass(slots=True)
class _StandingTraffic:
    """Time at which each actor in sight was last seen moving, with a resolution of 1 s."""

    _moved: dict[int, float] = field(default_factory=dict)
    _next: float = -math.inf

    def watch(self, world: World) -> None:
        if reaches(world.time, self._next):
            self._next = world.time + WATCH_S
            moving = world.actors.key[world.actors.speed > MOVING_MPS]
            self._moved.update(dict.fromkeys(moving.tolist(), world.time))

    def stood_s(self, world: World, row: int) -> float:
        """Time for which an actor has stood, s; -inf if it was never seen moving."""
        return world.time - self._moved.get(int(world.actors.key[row]), math.inf)


@dataclass(slots=True)
class Blocked(Criterion):
    """Detects an ego that stands for minutes; once per standstill.

    A gridlock is a kind of its own, since it says nothing about the agent: the ego queues behind a vehicle of the
    traffic that drove before and has stood for two minutes itself. A vehicle that never moved is parked, and the ego
    has to pass it; so it has where the queue stands before a static object, or before an actor of the ego's own events
    that never moved. Vehicles of a flow drove, and are traffic. Where another ego stands in sight, agents may have made
    the jam; `Judge` says the same of an ego that has collided.

    Attributes:
        standing_mps: An ego slower than this is standing, m/s.
        limit_s: Longest time that the ego may stand, s.

    Source: CARLA Leaderboard 2.1, ActorBlockedTest; the definition of a gridlock is ours.
    """

    kinds: ClassVar[tuple[InfractionKind, ...]] = (InfractionKind.BLOCKED, InfractionKind.GRIDLOCK)

    standing_mps: float = 0.1
    limit_s: float = 180.0
    _since: float = field(default=math.inf, init=False, repr=False)
    _reported: bool = field(default=False, init=False, repr=False)
    _queue: _StandingTraffic = field(default_factory=_StandingTraffic, init=False, repr=False)

    def start(self, world: World, ego: int) -> None:
        """Starts the clock of an ego that starts at rest."""
        self._watch(world, ego)

    def update(self, before: World, after: World, ego: int) -> Iterator[Infraction]:
        """Yields one infraction when the ego has stood for too long."""
        self._watch(after, ego)
        standing_s = after.time - self._since
        if exceeds(standing_s, self.limit_s) and not self._reported:
            self._reported = True
            leader = _leader(after, ego)
            jammed = leader >= 0 and reaches(self._queue.stood_s(after, leader), JAMMED_S)
            jammed = jammed and not self._obstructed(after, ego) and not self._with_other_egos(after, ego)
            kind = InfractionKind.GRIDLOCK if jammed else InfractionKind.BLOCKED
            actor = after.name_of(int(after.actors.key[leader])) if jammed else None
            yield infraction(kind, after, ego, standing_s, actor=actor)

    def _watch(self, world: World, ego: int) -> None:
        self._queue.watch(world)
        if world.egos.speed[ego] >= self.standing_mps:
            self._since = math.inf
            self._reported = False
        elif self._since == math.inf:
            self._since = world.time

    def _obstructed(self, world: World, ego: int) -> bool:
        """Whether a static object, or an actor of the ego's events that never moved, stands in its way, in sight."""
        egos, actors, route, near = world.egos, world.actors, world.routes[ego], world.egos.progress.item(ego)
        scripted = [key for event in world.events if event.ego == ego for key in event.actors]
        for row in np.flatnonzero(np.isin(actors.key, scripted) | (actors.kind == ActorKind.STATIC)).tolist():
            x, y = actors.position[row].tolist()
            along, aside, _ = route.project(x, y, near, ahead=SIGHT_M)
            beside = abs(aside) > 0.5 * (egos.width.item(ego) + actors.width.item(row))
            if along > near and not beside and self._queue.stood_s(world, row) == -math.inf:
                return True
        return False

    def _with_other_egos(self, world: World, ego: int) -> bool:
        """Whether another ego stands in sight."""
        egos = world.egos
        near = np.hypot(*(egos.position - egos.position[ego]).T) < SIGHT_M
        near[ego] = False
        return bool((near & egos.active & (egos.speed < MOVING_MPS)).any())


def _leader(world: World, ego: int) -> int:
    """Row of the vehicle that an ego queues behind, -1 if there is none. One beside its bumper is not ahead of it."""
    egos, actors, route = world.egos, world.actors, world.routes[ego]
    heading, width, near = egos.heading.item(ego), egos.width.item(ego), egos.progress.item(ego)
    front, lateral = 0.5 * egos.length.item(ego), egos.lateral.item(ego)
    best, leader = front + QUEUE_GAP_M, -1
    for row in np.flatnonzero(np.isin(actors.kind, _QUEUEING)).tolist():
        x, y = actors.position[row].tolist()
        along, aside, _ = route.project(x, y, near)
        gap = along - near - 0.5 * actors.length.item(row)
        beside = max(abs(aside), abs(aside - lateral)) > 0.5 * (width + actors.width.item(row))
        turned = abs(wrap(actors.heading.item(row) - heading)) > SAME_DIRECTION_RAD
        if front - TOUCHING_M < gap < best and not beside and not turned:
            best, leader = gap, row
    return leader
