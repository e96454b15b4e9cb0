"""Outside lanes: metres driven beside all lanes, or in a lane of the opposite direction."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

from dohyo.evaluation.criteria.base import Criterion, infraction
from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.events.kinds.obstacle import ObstacleEvent
from dohyo.sumo_networks.events.registry import EVENTS
from dohyo.sumo_networks.units import SIGHT_M
from dohyo.sumo_networks.world import EventPhase, World

TWO_WAYS = frozenset(kind for kind, event in EVENTS.items() if issubclass(event, ObstacleEvent) and event.two_ways)
"""Events whose obstacle the ego can only pass in the oncoming lane."""


@dataclass(slots=True)
class OutsideLanes(Criterion):
    """Measures the distance driven outside the lanes; one infraction per episode, where the ego first left them.

    While an event of `TWO_WAYS` of the ego runs in its sight, the oncoming lane is open to an ego that drives along its
    route. Off all lanes it is outside there too.

    Attributes:
        margin_m: Largest distance of the ego's centre beyond the edge of the nearest lane, m.
        metres: Distance driven outside so far, m.

    Source: CARLA Leaderboard 2.1, OutsideRouteLanesTest.
    """

    kinds: ClassVar[tuple[InfractionKind, ...]] = (InfractionKind.OUTSIDE_LANES,)

    margin_m: float = 0.5
    metres: float = field(default=0.0, init=False)
    _first: Infraction | None = field(default=None, init=False, repr=False)

    def update(self, before: World, after: World, ego: int) -> Iterator[Infraction]:
        """Yields no infraction: its size is only known at the end."""
        if self._is_outside(after, ego):
            self.metres += after.egos.driven.item(ego) - before.egos.driven.item(ego)
            if self._first is None and self.metres > 0.0:
                self._first = infraction(InfractionKind.OUTSIDE_LANES, after, ego, 0.0, actor=_lane(after, ego))
        return iter(())

    def finish(self, world: World, ego: int) -> Iterator[Infraction]:
        """Yields one infraction if the ego ever drove outside its lanes; its time and place are the first departure."""
        if self._first is not None:
            yield self._first.model_copy(update={"magnitude": self.metres})

    def _is_outside(self, world: World, ego: int) -> bool:
        egos, lanes = world.egos, world.network.lanes
        lane = egos.lane.item(ego)
        if lane < 0 or abs(egos.lane_offset.item(ego)) > 0.5 * lanes.width.item(lane) + self.margin_m:
            return True
        against = abs(egos.lane_heading_error.item(ego)) > math.pi / 2 and not lanes.internal[lane]
        return bool(against and not _may_borrow(world, ego))


def _may_borrow(world: World, ego: int) -> bool:
    """Whether an event asks the ego to borrow the oncoming lane."""
    forward = abs(world.egos.route_heading_error.item(ego)) < math.pi / 2
    return forward and any(
        one.ego == ego and one.kind in TWO_WAYS and one.phase is EventPhase.ACTIVE and abs(one.ahead) <= SIGHT_M
        for one in world.events
    )


def _lane(world: World, ego: int) -> str | None:
    lane = world.egos.lane.item(ego)
    return str(world.network.lanes.ids[lane]) if lane >= 0 else None
