"""EpisodeOrder: what the server asks of an episode process."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from dohyo.agents.registry import resolve
from dohyo.evaluation.agent import agent_info, make_agent
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.running.executors import Job
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Config, Scenario
from dohyo.sumo_networks.units import TICK_S


class EpisodeOrder(Config):
    """One episode to drive, and the folder of its record.

    Attributes:
        scenario: Scenario to drive.
        info: Agent, as its record will name it.
        benchmark: Name and content hash.
        directory: Folder for the record.
        stem: File name of the record without suffix.
        act_deadline_s: Wall-clock time for one decision.
        remote: Whether a policy worker decides.
        slow_policy: Whether the simulation waits for a slow worker, or goes on with its last decision.
        verdict: Status and reason of an episode that is recorded without driving.
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
        """Facts for the worker at the start of its lease: missions and seed, but not the rest of the scenario."""
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
        """Name of the agent."""
        return self.info.name

    @property
    def job(self) -> Job:
        """The order as a job of `dohyo.evaluation.running.executors`."""
        return Job(self.scenario, self.info, self.benchmark, self.directory, self.stem, self.act_deadline_s)


def checked_job(order: EpisodeOrder) -> Job:
    """An order's job, its agent's entry resolved.

    Raises:
        InvalidInputError: The installed code differs from the submitted code, so the record would be wrong.
    """
    entry = resolve(order.info.entry)
    if order.info.source_sha256:
        agent = make_agent(entry, order.info.settings)
        try:
            there = agent_info(agent, entry, order.info.settings)
        finally:
            agent.close()
        if (there.source_sha256, there.files_sha256) != (order.info.source_sha256, order.info.files_sha256):
            raise InvalidInputError(
                f"agent '{order.info.name}': its code has changed since it was submitted; submit it again"
            )
    return replace(order.job, info=order.info.model_copy(update={"entry": entry}))
