"""Mornings of a traffic benchmark: the scenario of one seed, and the record of one drive of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from pydantic import Field

from dohyo.evaluation.freeway.benchmark import TrafficBenchmark
from dohyo.evaluation.freeway.records import FreewayRecord, facts_at
from dohyo.evaluation.running.manifest import ResultManifest
from dohyo.sumo_networks.config import Config

MORNING, PLANNER = "morning", "planner"
LOWER_IS_BETTER = frozenset(
    {"speed_std_mps", "speed_std_within_mps", "fuel_circles_g_km", "collisions", "close_share", "waiting"}
)
"""Measures of a morning of which less is better."""


class MorningScenario(Config):
    """One morning: everything that is needed to drive it again.

    Attributes:
        benchmark: Times, and the share of connected cars.
        seed: Seed of the traffic.
    """

    name: ClassVar[str] = MORNING
    cell: ClassVar[str] = MORNING

    benchmark: TrafficBenchmark
    seed: int


class MorningRecord(FreewayRecord):
    """The facts of one morning.

    Attributes:
        scenario: Morning that was driven.
        outcome: Measures of all vehicles (`dohyo.evaluation.scores.traffic.Outcome`); a measure is None where no
            vehicle gave a value, and all are left out after a failure.
        plans: Number of plans that the planner published.
    """

    what: ClassVar[str] = "the record of a morning"

    scenario: MorningScenario
    outcome: Mapping[str, float | None] = Field(default_factory=dict)
    plans: int = 0


def is_morning(path: Path) -> bool:
    """Whether a file looks like the record of a morning, and not like that of a drive.

    Raises:
        InvalidInputError: The file is missing or too large.
    """
    facts = facts_at(path)
    return "plans" in facts and "egos" not in facts


class MorningsManifest(ResultManifest):
    """Description of a result folder of mornings."""

    benchmark: TrafficBenchmark
