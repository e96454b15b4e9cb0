"""Order: what the server asks of an episode process."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from evaluation.executors import Job
from evaluation.record import AgentInfo, Status
from sumo_networks.scenario import Config, Scenario


class Order(Config):
    """One episode to drive, and where its record goes.

    Attributes:
        scenario: What to drive.
        info: Who drives, as the record will say.
        benchmark: Name and content hash.
        directory: Folder of the record.
        stem: File name without suffix.
        act_deadline_s: Wall-clock time for one decision.
        remote: Whether a policy worker decides.
        slow_policy: Whether the simulation waits for a slow worker, or goes on with its last decision.
        verdict: Do not drive; write the record of an episode that ended so, and why.
    """

    scenario: Scenario
    info: AgentInfo
    benchmark: tuple[str, str]
    directory: Path
    stem: str
    act_deadline_s: float
    remote: bool = False
    slow_policy: Literal["wait", "realtime"] = "wait"
    verdict: tuple[Status, str] | None = None

    @property
    def job(self) -> Job:
        """The same for `evaluation.executors`."""
        return Job(self.scenario, self.info, self.benchmark, self.directory, self.stem, self.act_deadline_s)
