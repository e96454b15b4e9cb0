"""EpisodeOrder: what the server asks of an episode process."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from dohyo.agents.registry import resolve
from dohyo.evaluation.agent import agent_info, make_agent
from dohyo.evaluation.records.record import AgentInfo, Status
from dohyo.evaluation.running.executors import Job
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Config, Scenario
from dohyo.sumo_networks.units import TICK_S


class EpisodeOrder(Config):
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

    def told(self, version: int) -> dict[str, Any]:
        """What a worker is told of it with its lease: nothing of the scenario but its missions and its seed."""
        info = self.info
        return {
            "dt_s": TICK_S,
            "spec": {
                "name": info.name,
                "version": version,
                "track": info.track,
                "sensors": list(info.sensors),
                "control": info.control,
                "settings": info.settings,
            },
            "missions": [mission.model_dump(mode="json") for mission in self.scenario.missions],
            "seed": self.scenario.seed,
        }

    @property
    def agent(self) -> str:
        """Name of who drives."""
        return self.info.name

    @property
    def job(self) -> Job:
        """The same for `dohyo.evaluation.running.executors`."""
        return Job(self.scenario, self.info, self.benchmark, self.directory, self.stem, self.act_deadline_s)


def checked_job(order: EpisodeOrder) -> Job:
    """An order's job, its agent's entry resolved.

    Raises:
        InvalidInputError: The code here is other than was submitted: the record would tell a lie.
    """
    entry = resolve(order.info.entry)
    if order.info.source_sha256:
        agent = make_agent(entry, order.info.settings)
        try:
            there = agent_info(agent, entry, order.info.settings)
        finally:
            agent.close()
        if there.source_sha256 != order.info.source_sha256:
            raise InvalidInputError(
                f"agent '{order.info.name}': its code has changed since it was submitted; submit it again"
            )
    return replace(order.job, info=order.info.model_copy(update={"entry": entry}))
