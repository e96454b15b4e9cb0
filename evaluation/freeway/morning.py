"""Mornings of a traffic benchmark: the scenario of one seed, and the record of one drive of it.

A record is one JSON file. Its hash covers everything in it except the wall-clock time.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import Field, ValidationError

from dohyo.evaluation.freeway.benchmark import TrafficBenchmark
from dohyo.evaluation.records.foreign_files import read_limited
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.records.store import FACTS_LIMIT_BYTES
from dohyo.evaluation.running.manifest import ResultManifest
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.scenario import content_hash

MORNING, PLANNER = "morning", "planner"
LARGEST_BYTES = 1_000_000
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


class MorningRecord(Config):
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
        wall_s: Wall-clock time, s; in no hash.
        record_hash: Hex sha256 of all the rest.
    """

    format: Literal[1] = 1
    scenario: MorningScenario
    benchmark: tuple[str, str]
    agent: AgentInfo
    failure: str | None = None
    outcome: Mapping[str, float | None] = Field(default_factory=dict)
    plans: int = 0
    wall_s: float = 0.0
    record_hash: str = ""

    def sealed(self) -> MorningRecord:
        """The record with its hash."""
        return self.model_copy(update={"record_hash": self.content_hash()})

    def content_hash(self) -> str:
        """Hash of the facts."""
        facts: dict[str, Any] = self.model_dump(mode="json", exclude={"record_hash", "wall_s"})
        return content_hash(facts)


def write_morning(directory: Path, stem: str, record: MorningRecord) -> None:
    """Writes a record, complete or not at all."""
    directory.mkdir(parents=True, exist_ok=True)
    write_atomically(directory / f"{stem}.json", record.sealed().model_dump_json(indent=1).encode())


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
    try:
        record = MorningRecord.model_validate_json(content)
    except ValidationError as error:
        raise InvalidInputError(f"{path}: expected {WHAT}: {error.errors()[0]['msg']}") from error
    if record.record_hash != record.content_hash():
        raise InvalidInputError(f"{path}: the record has been changed: its hash is another one")
    return record


def is_morning(path: Path) -> bool:
    """Whether a file looks like the record of a morning, and not like that of a drive.

    Raises:
        InvalidInputError: The file is missing or too large.
    """
    try:
        document = json.loads(read_limited(path, "a record", FACTS_LIMIT_BYTES))
    except (ValueError, RecursionError):
        return False
    return isinstance(document, dict) and "plans" in document and "egos" not in document


class MorningsManifest(ResultManifest):
    """Description of a result folder of mornings."""

    benchmark: TrafficBenchmark
