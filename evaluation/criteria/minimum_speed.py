"""Minimum speed: the ego is slower than the traffic around it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numba import njit

from dohyo.evaluation.criteria.base import Criterion, infraction
from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.actors.names import is_event_actor
from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.world import ActorKind, World


@dataclass(slots=True)
class MinimumSpeed(Criterion):
    """Compares the mean speeds of the ego and of the motor vehicles around it, on equal parts of its route.

    Only cars, vans, trucks and buses within `sight_m` of the ego count, standing ones included. Those that an event has
    put there, crashed or parked, are no traffic before they move. Every tick with a vehicle that counts has the same
    weight; ticks without any do not count, neither for the traffic nor for the ego. A part without any gives no
    infraction. The last part ends with the episode, and is judged only if the ego came near the goal.

    Attributes:
        checkpoints: Largest number of parts; a short route has fewer.
        shortest_part_m: Shortest length of a part, m, so that a single red light does not decide it.
        sight_m: Largest distance between the centres of the ego and a vehicle that counts, m.
        near_goal: Share of the route beyond which the last part counts as driven.

    Source: CARLA Leaderboard 2.1, MinimumSpeedRouteTest, which averages all vehicles of the background activity, and
    whose routes are kilometres long.
    """

    kinds: ClassVar[tuple[InfractionKind, ...]] = (InfractionKind.MINIMUM_SPEED,)

    checkpoints: int = 4
    shortest_part_m: float = 500.0
    sight_m: float = 100.0
    near_goal: float = 0.95
    _parts: int = field(default=1, init=False, repr=False)
    _passed: int = field(default=0, init=False, repr=False)
    _ego_sum: float = field(default=0.0, init=False, repr=False)
    _traffic_sum: float = field(default=0.0, init=False, repr=False)
    _moved: set[int] = field(default_factory=set, init=False, repr=False)

    def start(self, world: World, ego: int) -> None:
        """Divides the route into parts."""
        self._parts = min(max(int(world.routes[ego].length / self.shortest_part_m), 1), self.checkpoints)

    def update(self, before: World, after: World, ego: int) -> Iterator[Infraction]:
        """Yields at most one infraction at each checkpoint but the last."""
        egos, actors = after.egos, after.actors
        kind = self._without_parked(after)
        traffic = _mean_traffic_speed(egos.position, ego, self.sight_m, kind, actors.position, actors.speed)
        if traffic >= 0.0:
            self._ego_sum += egos.speed.item(ego)
            self._traffic_sum += traffic
        reached = egos.progress.item(ego) * self._parts >= (self._passed + 1) * after.routes[ego].length
        if reached and self._passed < self._parts - 1:
            yield from self._judge(after, ego)

    def finish(self, world: World, ego: int) -> Iterator[Infraction]:
        """Yields at most one infraction for the last part, if it was driven."""
        near = world.egos.progress.item(ego) > self.near_goal * world.routes[ego].length
        if self._passed == self._parts - 1 and near:
            yield from self._judge(world, ego)

    def _without_parked(self, world: World) -> IntArray:
        """(M,) ActorKind of each actor; STATIC for one that an event has put there and that never moved in sight."""
        actors = world.actors
        keys = [key for event in world.events for key in event.actors if is_event_actor(world.name_of(key))]
        if not keys:
            return actors.kind
        scripted = np.isin(actors.key, keys)
        self._moved.update(actors.key[scripted & (actors.speed > 0.0)].tolist())
        parked = scripted & ~np.isin(actors.key, list(self._moved))
        return np.where(parked, int(ActorKind.STATIC), actors.kind)

    def _judge(self, world: World, ego: int) -> Iterator[Infraction]:
        if self._ego_sum < self._traffic_sum:
            percent = 100.0 * self._ego_sum / self._traffic_sum
            yield infraction(InfractionKind.MINIMUM_SPEED, world, ego, percent)
        self._passed += 1
        self._ego_sum = self._traffic_sum = 0.0


_LAST_MOTOR_VEHICLE = int(ActorKind.BUS)


@njit(cache=True)
def _mean_traffic_speed(
    egos: FloatArray, ego: int, sight: float, kind: IntArray, position: FloatArray, speed: FloatArray
) -> float:
    """Mean speed of the motor vehicles around an ego.

    Args:
        egos: (E, 2) centres, m, network frame.
        ego: Index of the ego.
        sight: Largest distance from the ego, m.
        kind: (M,) ActorKind of each actor.
        position: (M, 2) centres of the actors, m, network frame.
        speed: (M,) speeds of the actors, m/s.

    Returns:
        Mean speed, m/s; -1 if there is no such vehicle.
    """
    total, count = 0.0, 0
    for i in range(kind.shape[0]):
        dx, dy = position[i, 0] - egos[ego, 0], position[i, 1] - egos[ego, 1]
        if kind[i] <= _LAST_MOTOR_VEHICLE and dx * dx + dy * dy <= sight * sight:
            total += speed[i]
            count += 1
    return total / count if count else -1.0
