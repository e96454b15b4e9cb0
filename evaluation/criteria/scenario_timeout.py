"""Scenario timeout: a scripted event around the ego is not over in time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from dohyo.evaluation.criteria.base import Criterion, infraction
from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.world import EventPhase, World


@dataclass(slots=True)
class ScenarioTimeout(Criterion):
    """Detects an event that the ego has triggered and that is not over within its time, once per event.

    The time is the event's own (`timeout_s`), by default 240 s of simulated time. An event that the ego has not
    triggered, or that still runs when the ego's episode ends, gives no infraction.

    Source: CARLA Leaderboard 2.1, ScenarioTimeoutTest.
    """

    kinds: ClassVar[tuple[InfractionKind, ...]] = (InfractionKind.SCENARIO_TIMEOUT,)

    def update(self, before: World, after: World, ego: int) -> Iterator[Infraction]:
        """Yields one infraction for each event that has exceeded its time."""
        for earlier, event in zip(before.events, after.events, strict=True):
            if event.ego == ego and event.phase is EventPhase.TIMED_OUT and earlier.phase is EventPhase.ACTIVE:
                elapsed_s = event.ended - event.started
                yield infraction(InfractionKind.SCENARIO_TIMEOUT, after, ego, elapsed_s, actor=event.name)
