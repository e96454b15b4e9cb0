"""Job: one episode to drive, and how long and how often executors try; imported without a simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from dohyo.evaluation.records.record import AgentInfo
from dohyo.sumo_networks.scenario import Scenario

MAX_ATTEMPTS = 2
KILL_GRACE_S = 5.0
POLL_S = 0.5


@dataclass(frozen=True, slots=True)
class Job:
    """One episode to drive, with the path of its record.

    Attributes:
        scenario: Scenario to drive.
        infos: Description of each ego's agent, by the name of the mission.
        benchmark: Name and content hash of the benchmark.
        directory: Folder of the record.
        stem: File name without suffix.
        act_deadline_s: Wall-clock time allowed for one decision, s.
    """

    scenario: Scenario
    infos: Mapping[str, AgentInfo]
    benchmark: tuple[str, str] | None
    directory: Path
    stem: str
    act_deadline_s: float
