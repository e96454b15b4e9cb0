"""Criterion: watches one ego for one kind of infraction; reads worlds and yields infractions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import ClassVar, Self

from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.world import World


class Criterion(ABC):
    """Detects one kind of infraction. One instance watches one ego for one episode.

    Criteria read the world and never change it; their state between ticks is in private fields.

    Attributes:
        kinds: Kinds of infraction that it yields, usually one.
    """

    __slots__ = ()
    kinds: ClassVar[tuple[InfractionKind, ...]]

    @classmethod
    def for_scenario(cls, scenario: Scenario) -> Self:
        """The criterion with the thresholds of a scenario."""
        return cls()

    def start(self, world: World, ego: int) -> None:  # noqa: B027 - most criteria need no preparation
        """Prepares for the world in which the ego starts."""

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
    """An infraction of an ego at its place and time in a world."""
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
