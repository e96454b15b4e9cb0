"""Mornings of a traffic benchmark: the scenario of one seed, and the record of one drive of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field

from dohyo.evaluation.freeway.benchmark import TrafficBenchmark
from dohyo.evaluation.freeway.records import (
    LARGEST_BYTES,
    FreewayRecord,
    facts_at,
    parse_freeway_record,
    write_freeway_record,
)
from dohyo.evaluation.records.foreign_files import read_limited
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.running.manifest import ResultManifest
from dohyo.sumo_networks.config import Config

MORNING, PLANNER = "morning", "planner"
WHAT = "the record of a morning"
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
        format: Version of this format.
        scenario: Morning that was driven.
        benchmark: Name and content hash.
        agent: The planner.
        failure: Fault of the planner that ended the morning; None: it was driven to its end.
        outcome: Measures of all vehicles (`dohyo.evaluation.scores.traffic.Outcome`); a measure is None where no
            vehicle gave a value, and all are left out after a failure.
        plans: Number of plans that the planner published.
    """

    format: Literal[1] = 1
    scenario: MorningScenario
    benchmark: tuple[str, str]
    agent: AgentInfo
    failure: str | None = None
    outcome: Mapping[str, float | None] = Field(default_factory=dict)
    plans: int = 0


def write_morning(directory: Path, stem: str, record: MorningRecord) -> None:
    """Writes a record, complete or not at all."""
    write_freeway_record(directory, stem, record)


def read_morning(path: Path) -> MorningRecord:
    """Reads a record.

    Raises:
        InvalidInputError: The file is missing, or no such record, or its hash is another one.
    """
    return parse_morning(read_limited(path, WHAT, LARGEST_BYTES), str(path))


def parse_morning(content: bytes, path: str) -> MorningRecord:
    """Parses the content of a record's file and checks its hash.

    Args:
        content: Content of the file.
        path: Name of the file in messages.

    Raises:
        InvalidInputError: It is no record of a morning, or its hash is another one.
    """
    return parse_freeway_record(content, path, MorningRecord, WHAT)


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
