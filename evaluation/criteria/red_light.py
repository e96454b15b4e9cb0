"""Red light: the ego crosses a stop line, or passes it beside its road, while its light is red."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from dohyo.evaluation.criteria.base import Criterion, infraction
from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.rules.red_signal import red_signal
from dohyo.sumo_networks.rules.stop_lines import Point, axis_point, crossed_stop_lines, front, passed_stop_lines
from dohyo.sumo_networks.world import World


@dataclass(slots=True)
class RedLight(Criterion):
    """Detects running a red light; yellow is no infraction.

    The state of the light is that after the tick, under which SUMO moved the traffic in that tick. If the ego's route
    crosses the stop line, the signal of the route decides; elsewhere the light is red if every signal of the lane is
    red. The same light, which is one approach to a junction, is not counted twice in a row. A line of the route counts
    also where the front passes it beside the road.

    Attributes:
        reference: Part of the ego that must cross. "front" (default): the middle of the front bumper. "tail": CARLA's
            test, a piece of the ego's axis from 0.8 half-lengths behind its centre to 1 m behind its rear bumper; with
            it, entering late on yellow can count.

    Source: CARLA Leaderboard 2.1, RunningRedLightTest.
    """

    kinds: ClassVar[tuple[InfractionKind, ...]] = (InfractionKind.RED_LIGHT,)

    reference: Literal["front", "tail"] = "front"
    _any_lit: bool = field(default=True, init=False, repr=False)
    _last_approach: int = field(default=-1, init=False, repr=False)

    def start(self, world: World, ego: int) -> None:
        """Finds out whether the network has any lights."""
        self._any_lit = bool(world.network.stop_lines.lit.any())

    def update(self, before: World, after: World, ego: int) -> Iterator[Infraction]:
        """Yields an infraction per red light and passage."""
        if not self._any_lit:
            return
        motion = _front_motion if self.reference == "front" else _tail
        crossed = crossed_stop_lines(after, ego, *motion(before, after, ego))
        for row in (*crossed, *passed_stop_lines(before, after, ego)):
            network = after.network
            lane = int(network.stop_lines.lane[row])
            signal = red_signal(after, ego, lane) if network.stop_lines.lit[row] else -1
            approach = int(network.lanes.edge[lane])
            if signal < 0 or approach == self._last_approach:
                continue
            self._last_approach = approach
            light = str(network.signals.light_ids[network.signals.light[signal]])
            speed = after.egos.speed.item(ego)
            yield infraction(InfractionKind.RED_LIGHT, after, ego, speed, actor=light)


def _front_motion(before: World, after: World, ego: int) -> tuple[Point, Point]:
    return front(before.egos, ego), front(after.egos, ego)


def _tail(before: World, after: World, ego: int) -> tuple[Point, Point]:
    """CARLA's piece of the ego's axis, longer for an ego that is fast enough to jump over a line within a tick."""
    half = 0.5 * after.egos.length.item(ego)
    rear, fore = axis_point(after.egos, ego, -half - 1.0), axis_point(after.egos, ego, -0.8 * half)
    fore_before = axis_point(before.egos, ego, -0.8 * half)
    return (rear if math.dist(fore_before, fore) < math.dist(rear, fore) else fore_before), fore
