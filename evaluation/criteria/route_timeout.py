"""Route timeout: the ego takes too long."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np

from dohyo.evaluation.criteria.base import Criterion, infraction
from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.rules.episode_end import is_late
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.world import World


@dataclass(slots=True)
class RouteTimeout(Criterion):
    """Detects an ego that has not arrived in time, once per episode.

    Attributes:
        limit_s: Time allowed, s; None: `fixed_s` plus the route's time at `speed_share` of its speed limits.
        fixed_s: The fixed time, s.
        speed_share: Share of the speed limits, in (0, 1].

    Source: CARLA Leaderboard 2.1, RouteTimeoutBehavior.
    """

    kinds: ClassVar[tuple[InfractionKind, ...]] = (InfractionKind.ROUTE_TIMEOUT,)

    limit_s: float | None = None
    fixed_s: float = 300.0
    speed_share: float = 0.1
    _limit: float = field(default=0.0, init=False, repr=False)
    _reported: bool = field(default=False, init=False, repr=False)

    @classmethod
    def for_scenario(cls, scenario: Scenario) -> Self:
        """The criterion with the scenario's own time limit, if it has one."""
        return cls(limit_s=scenario.time_limit_s)

    def allowed_s(self, route: Route) -> float:
        """Time allowed on a route, s."""
        return self.fixed_s + travel_time(route) / self.speed_share if self.limit_s is None else self.limit_s

    def start(self, world: World, ego: int) -> None:
        """Computes the time allowed."""
        self._limit = self.allowed_s(world.routes[ego])

    def update(self, before: World, after: World, ego: int) -> Iterator[Infraction]:
        """Yields one infraction when the time is up."""
        if is_late(after, self._limit) and not self._reported:
            self._reported = True
            yield infraction(InfractionKind.ROUTE_TIMEOUT, after, ego, after.time)


def travel_time(route: Route) -> float:
    """Time that a route takes at its speed limits, s."""
    spacing = route.length / (len(route.position) - 1)
    return float(np.sum(spacing / route.speed_limit[:-1]))
