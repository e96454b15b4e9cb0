"""Stop sign: the ego's front crosses the line of a stop sign or arrow without having stood before it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

from dohyo.evaluation.criteria.base import Criterion, infraction
from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.rules.red_signal import has_stop_arrow
from dohyo.sumo_networks.rules.stop_lines import crossed_stop_lines, distance_to_line, front, passed_stop_lines
from dohyo.sumo_networks.world import World


@dataclass(slots=True)
class StopSign(Criterion):
    """Detects rolling over the line of a stop sign, or over a light's line while its green right-turn arrow shows.

    The ego must have stood in the last metres that it drove before its front crossed the line. CARLA's trigger area is
    a box around the sign; SUMO does not know the place of signs. The state of the light is that after the tick. A line
    of the route counts also where the front passes it beside the road.

    Attributes:
        within_m: Largest distance before the line at which the ego's front must have stood, m.
        standing_mps: An ego slower than this is standing, m/s.

    Source: CARLA Leaderboard 2.1, RunningStopTest.
    """

    kinds: ClassVar[tuple[InfractionKind, ...]] = (InfractionKind.STOP_SIGN,)

    within_m: float = 4.0
    standing_mps: float = 0.1
    _any_signed: bool = field(default=True, init=False, repr=False)
    _stood_at: float = field(default=-math.inf, init=False, repr=False)

    def start(self, world: World, ego: int) -> None:
        """Finds out whether the network has any stop signs, or lights that ask for a stop."""
        self._any_signed = bool(world.network.stop_lines.stop_sign.any()) or len(world.duties) > 0

    def update(self, before: World, after: World, ego: int) -> Iterator[Infraction]:
        """Yields an infraction per line crossed without a stop."""
        if not self._any_signed:
            return
        if before.egos.speed[ego] < self.standing_mps:
            self._stood_at = before.egos.driven.item(ego)
        fore = front(before.egos, ego)
        crossed = crossed_stop_lines(after, ego, fore, front(after.egos, ego))
        for row in (*crossed, *passed_stop_lines(before, after, ego)):
            stop_lines = after.network.stop_lines
            to_line = distance_to_line(*fore, *stop_lines.segment[row].tolist())
            if before.egos.driven[ego] - self._stood_at + to_line <= self.within_m:
                continue
            lane = stop_lines.lane.item(row)
            if stop_lines.stop_sign[row] or has_stop_arrow(after, ego, lane):
                name = str(after.network.lanes.ids[lane])
                yield infraction(InfractionKind.STOP_SIGN, after, ego, after.egos.speed.item(ego), actor=name)
