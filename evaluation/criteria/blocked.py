"""Blocked: the ego has stood still for too long."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

from evaluation.criteria.base import Criterion, infraction
from evaluation.record import Infraction, InfractionKind
from sumo_networks.world import World


@dataclass(slots=True)
class Blocked(Criterion):
    """Detects an ego that stands for minutes, for whatever reason; once per standstill.

    Attributes:
        standing_mps: Slower than this is standing, m/s.
        limit_s: Standing for longer is an infraction, s.

    Source: CARLA Leaderboard 2.1, ActorBlockedTest.
    """

    standing_mps: float = 0.1
    limit_s: float = 180.0
    _since: float = field(default=math.inf, init=False, repr=False)
    _reported: bool = field(default=False, init=False, repr=False)

    def start(self, world: World, ego: int) -> None:
        """Starts the clock of an ego that starts at rest."""
        self._watch(world, ego)

    def update(self, before: World, after: World, ego: int) -> Iterator[Infraction]:
        """Yields one infraction when the ego has stood for too long."""
        self._watch(after, ego)
        standing_s = after.time - self._since
        if standing_s > self.limit_s and not self._reported:
            self._reported = True
            yield infraction(InfractionKind.BLOCKED, after, ego, standing_s, "s")

    def _watch(self, world: World, ego: int) -> None:
        if world.egos.speed[ego] >= self.standing_mps:
            self._since = math.inf
            self._reported = False
        elif self._since == math.inf:
            self._since = world.time
