"""Route deviation: the ego has left its route for good."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

from dohyo.evaluation.criteria.base import Criterion, infraction
from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.world import World


@dataclass(slots=True)
class RouteDeviation(Criterion):
    """Detects an ego that is far from the part of the route around its progress, once per episode.

    Attributes:
        far_m: Distance that is a deviation at any moment, m.
        away_m: Distance that is allowed only for a part of the route, m.
        away_share: Largest share of the route that the ego may drive at more than `away_m`, in [0, 1].

    Source: CARLA Leaderboard 2.1, InRouteTest.
    """

    kinds: ClassVar[tuple[InfractionKind, ...]] = (InfractionKind.ROUTE_DEVIATION,)

    far_m: float = 30.0
    away_m: float = 15.0
    away_share: float = 0.3
    _progress_away: float = field(default=0.0, init=False, repr=False)
    _reported: bool = field(default=False, init=False, repr=False)

    def update(self, before: World, after: World, ego: int) -> Iterator[Infraction]:
        """Yields one infraction when the ego has deviated; its magnitude is the distance from the route."""
        distance = abs(after.egos.lateral.item(ego))
        if distance < self.away_m or self._reported:
            return
        self._progress_away += max(after.egos.progress.item(ego) - before.egos.progress.item(ego), 0.0)
        if distance >= self.far_m or self._progress_away > self.away_share * after.routes[ego].length:
            self._reported = True
            yield infraction(InfractionKind.ROUTE_DEVIATION, after, ego, distance)
