"""Job: one episode to drive, and how long and how often executors try; imported without a simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from dohyo.evaluation.records.record import AgentInfo
from dohyo.sumo_networks.scenario import Scenario

MAX_ATTEMPTS = 2
KILL_GRACE_S = 5.0
POLL_S = 0.5
NEVER_RETURNED = "agent never returned; its process was ended"
DIED_TWICE = "the process died twice while the agent was called"


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
        hung: Why an agent is at fault that ended with its process, by ego. These egos drive no more, and the other
            agents drive without them.
        suspect: In a mixed run, ego whose agent was called when the process died; None: no process has died.
    """

    scenario: Scenario
    infos: Mapping[str, AgentInfo]
    benchmark: tuple[str, str] | None
    directory: Path
    stem: str
    act_deadline_s: float
    hung: Mapping[str, str] = field(default_factory=dict)
    suspect: str | None = None

    def without(self, ego: int, why: str) -> Job | None:
        """The job without the agent that ended with its process, for the other agents to drive again.

        Args:
            ego: Number of an ego of that agent; all of its egos are at fault.
            why: Reason, for the record.

        Returns:
            The job; None where no other agent is left.
        """
        culprit = self.infos[self.scenario.missions[ego].name]
        hung = {**self.hung, **{name: why for name, info in self.infos.items() if info == culprit}}
        return replace(self, hung=hung, suspect=None) if len(self.hung) < len(hung) < len(self.infos) else None

    def after_death(self, ego: int) -> Job | None:
        """The job after its process died while an agent of a mixed run was called.

        Args:
            ego: Number of the ego whose agent was called.

        Returns:
            The same job once more; after two deaths with the same agent the job without that agent. None with agents
            that differ, and where no other agent drives: nobody can be blamed.
        """
        others, name = self.without(ego, DIED_TWICE), self.scenario.missions[ego].name
        if others is None:
            return None
        if self.suspect is None:
            return replace(self, suspect=name)
        return others if self.infos[self.suspect] == self.infos[name] else None
