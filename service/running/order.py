"""EpisodeOrder: what the server asks of an episode process."""

from __future__ import annotations

import hmac
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from dohyo.agents.registry import resolve
from dohyo.evaluation.agent import agent_info, close_agent, make_agent
from dohyo.evaluation.freeway.day import FORECASTER, DayScenario
from dohyo.evaluation.freeway.morning import MorningScenario
from dohyo.evaluation.parking.benchmark import LotScenario
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.running.job import Job
from dohyo.service.freeway.planner import DECIDES_EVERY_S
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Config, Mission, Scenario
from dohyo.sumo_networks.units import TICK_S


class EpisodeOrder(Config):
    """One episode to drive, and the folder of its record.

    Attributes:
        scenario: Scenario to drive, a morning on the freeway to plan, a lot to park in, or a day to forecast.
        info: Agent, as its record will name it.
        others: Agents of single egos of a mixed run, by ego; `info` drives all other egos.
        benchmark: Name and content hash.
        directory: Folder for the record.
        stem: File name of the record without suffix.
        act_deadline_s: Wall-clock time for one decision.
        remote: Whether a policy worker decides.
        slow_policy: Whether the simulation waits for a slow worker, or goes on with its last decision.
        agent_seed: Seed that a remote agent is given; the seeds of traffic and events do not follow from it.
        hung: Why an agent of a mixed run is at fault that ended with its process, by ego.
        suspect: In a mixed run, ego whose agent was called when the process died; None: no process has died.
        verdict: Status and reason of an episode that is recorded without driving.
    """

    scenario: Scenario | MorningScenario | LotScenario | DayScenario
    info: AgentInfo
    others: dict[str, AgentInfo] = Field(default_factory=dict)
    benchmark: tuple[str, str]
    directory: Path
    stem: str
    act_deadline_s: float
    remote: bool = False
    slow_policy: Literal["wait", "realtime"] = "wait"
    agent_seed: int = 0
    hung: dict[str, str] = Field(default_factory=dict)
    suspect: str | None = None
    verdict: tuple[Status, str] | None = None

    def told(self, version: int) -> dict[str, Any]:
        """Facts for the worker at the start of its lease.

        They are the same for all scenarios with as many egos, except on the track `privileged`, whose worker gets the
        missions too. From a scenario's names and seed a worker could simulate the same world, and look into its future.
        """
        info = self.info
        return {
            "dt_s": self.decision_s,
            "spec": {
                "name": info.name,
                "version": version,
                "track": info.track,
                "sensors": list(info.sensors),
                "control": info.control,
                "settings": info.settings,
            },
            "missions": [self._told_mission(mission) for mission in self.missions] or self._told_names(),
            "seed": self.agent_seed,
        }

    def _told_mission(self, mission: Mission) -> dict[str, Any]:
        name = {"name": self.wire_names[mission.name]}
        if self.info.track != "privileged":
            return name
        return mission.model_dump(mode="json", include={"start", "goal", "via"}) | name

    def _told_names(self) -> list[dict[str, str]]:
        return [{"name": name} for name in self.wire_names.values()]

    @property
    def wire_names(self) -> dict[str, str]:
        """Name of each ego on the wire: a name in the scenario may be that of a public mission."""
        if isinstance(self.scenario, DayScenario):
            return {FORECASTER: FORECASTER}
        return {ego: "ego" if len(self.egos) == 1 else f"ego-{number}" for number, ego in enumerate(self.egos)}

    @property
    def egos(self) -> tuple[str, ...]:
        """Names of the egos: those of the missions, or of the karts; that of the forecaster of a day."""
        if isinstance(self.scenario, DayScenario):
            return (FORECASTER,)
        if isinstance(self.scenario, LotScenario):
            return tuple(f"kart-{number}" for number in range(self.scenario.benchmark.karts))
        return tuple(mission.name for mission in self.missions)

    @property
    def decision_s(self) -> float:
        """Simulated time between two decisions, s."""
        return DECIDES_EVERY_S if isinstance(self.scenario, MorningScenario | DayScenario) else TICK_S

    @property
    def missions(self) -> tuple[Mission, ...]:
        """Missions of the egos; none in a morning, in a lot and on a day of forecasts."""
        return self.scenario.missions if isinstance(self.scenario, Scenario) else ()

    @property
    def agent(self) -> str:
        """Name of the agent."""
        return self.info.name

    @property
    def infos(self) -> dict[str, AgentInfo]:
        """Agent of each ego."""
        return {ego: self.others.get(ego, self.info) for ego in self.egos}

    @property
    def job(self) -> Job:
        """The order as a job of `dohyo.evaluation.running.executors`.

        Raises:
            InvalidInputError: The order is of a morning, which only policy workers plan, of a lot, or of a day.
        """
        if not isinstance(self.scenario, Scenario):
            raise InvalidInputError(f"expected an episode on roads, got a {self.scenario.name}")
        return Job(
            *(self.scenario, self.infos, self.benchmark, self.directory, self.stem, self.act_deadline_s),
            self.hung,
            self.suspect,
        )

    def without(self, ego: int, why: str) -> EpisodeOrder | None:
        """The order without an agent of a mixed run that never returned; None where no other agent is left.

        Args:
            ego: Number of an ego of that agent.
            why: Reason, for the record.
        """
        return self._changed(self.job.without(ego, why)) if self.others else None

    def after_death(self, ego: int) -> EpisodeOrder | None:
        """The order after its process died while an agent was called; see `Job.after_death`."""
        return self._changed(self.job.after_death(ego)) if self.others else None

    def _changed(self, job: Job | None) -> EpisodeOrder | None:
        return self.model_copy(update={"hung": dict(job.hung), "suspect": job.suspect}) if job is not None else None


def agent_seed(secret: str, position: int) -> int:
    """Seed of a remote agent in an episode: the same in each attempt, and unrelated to the scenario's seed.

    Args:
        secret: Secret of the evaluation.
        position: Position of the episode in the benchmark.
    """
    digest = hmac.digest(secret.encode(), str(position).encode(), "sha256")
    return int.from_bytes(digest[:4], "big") >> 1  # every language and generator takes 31 bits


def checked_job(order: EpisodeOrder) -> Job:
    """An order's job, the entries of its agents resolved.

    Raises:
        InvalidInputError: The installed code differs from the submitted code, so the record would be wrong.
    """
    job = order.job
    submitted = {info.model_dump_json(): info for info in job.infos.values()}
    checked = {document: _checked(info) for document, info in submitted.items()}
    return replace(job, infos={ego: checked[info.model_dump_json()] for ego, info in job.infos.items()})


def check_unchanged(submitted: AgentInfo, there: AgentInfo) -> None:
    """Checks that an agent is the one which was submitted, since the record would be wrong.

    Raises:
        InvalidInputError: Its code differs.
    """
    if (there.source_sha256, there.files_sha256) != (submitted.source_sha256, submitted.files_sha256):
        raise InvalidInputError(
            f"agent '{submitted.name}': its code has changed since it was submitted; submit it again"
        )


def _checked(info: AgentInfo) -> AgentInfo:
    """A submitted agent, its entry resolved, after a comparison with the installed code."""
    entry = resolve(info.entry)
    if info.source_sha256:
        agent = make_agent(entry, info.settings)
        try:
            there = agent_info(agent, entry, info.settings)
        finally:
            close_agent(agent)
        check_unchanged(info, there)
    return info.model_copy(update={"entry": entry})
