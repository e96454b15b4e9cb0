"""Criterion: watches one ego for one kind of infraction; facts in, events out."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import ClassVar, Self

from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.world import Egos, World

Point = tuple[float, float]


class Criterion(ABC):
    """Detects one kind of infraction. One instance watches one ego for one episode.

    Criteria read the world and never change it; what they must remember is in private fields.

    Attributes:
        kinds: What it detects; a criterion may divide its infraction into several kinds.
    """

    __slots__ = ()
    kinds: ClassVar[tuple[InfractionKind, ...]]

    @classmethod
    def for_scenario(cls, scenario: Scenario) -> Self:
        """The criterion with the thresholds that a scenario asks for."""
        return cls()

    def start(self, world: World, ego: int) -> None:  # noqa: B027 - most criteria have nothing to prepare
        """Looks at the world in which the ego starts."""

    @abstractmethod
    def update(self, before: World, after: World, ego: int) -> Iterator[Infraction]:
        """Infractions of one tick.

        Args:
            before: The world before the tick.
            after: The world after it.
            ego: Index of the ego.
        """

    def finish(self, world: World, ego: int) -> Iterator[Infraction]:
        """Infractions that are only known when the ego's episode has ended.

        Args:
            world: The last world of the episode.
            ego: Index of the ego.
        """
        return iter(())


def infraction(
    kind: InfractionKind,
    world: World,
    ego: int,
    magnitude: float,
    *,
    actor: str | None = None,
    at_fault: bool | None = None,
) -> Infraction:
    """An infraction of an ego, here and now."""
    x, y = world.egos.position[ego].tolist()
    return Infraction(
        kind=kind,
        time_s=world.time,
        x_m=x,
        y_m=y,
        route_m=world.egos.progress.item(ego),
        actor=actor,
        magnitude=magnitude,
        at_fault=at_fault,
    )


def axis_point(egos: Egos, ego: int, ahead: float) -> Point:
    """Point on an ego's longitudinal axis.

    Args:
        egos: All egos.
        ego: Which one.
        ahead: m ahead of the centre of its box, negative behind.

    Returns:
        x, y, m, network frame.
    """
    heading = egos.heading.item(ego)
    x, y = egos.position[ego].tolist()
    return x + ahead * math.cos(heading), y + ahead * math.sin(heading)


def front(egos: Egos, ego: int) -> Point:
    """Middle of an ego's front bumper, m, network frame."""
    return axis_point(egos, ego, 0.5 * egos.length.item(ego))


def crossed_stop_lines(world: World, ego: int, start: Point, end: Point) -> list[int]:
    """Stop lines that a motion of the ego crosses in driving direction.

    Networks are flat: a road may pass over or under another one's stop line. An ego on its route therefore meets only
    the lines of its route and of the edge it is on.

    Args:
        world: The world after the motion.
        ego: Index of the ego.
        start: Where the motion begins, m, network frame.
        end: Where it ends.

    Returns:
        Rows of `RoadNetwork.stop_lines`.
    """
    rows = world.network.crossed_stop_lines(*start, *end)
    if not len(rows):
        return []
    lanes, on_route = world.network.lanes, world.routes[ego].on_route
    here = world.egos.lane.item(ego)
    if here < 0 or lanes.internal[here] or not on_route[here]:
        return [int(row) for row in rows]
    guarded = world.network.stop_lines.lane[rows]
    meets = on_route[guarded] | (lanes.edge[guarded] == lanes.edge[here])
    return [int(row) for row in rows[meets]]
