"""run_episode: one scenario, one agent per ego, one record."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version

import numpy as np

from dohyo.evaluation.agent import Agent, Observation, agent_info
from dohyo.evaluation.episode.guarded_agent import ACT_DEADLINE_S, AgentFailedError, GuardedAgent
from dohyo.evaluation.episode.judge import Judge
from dohyo.evaluation.records.record import AgentInfo, EgoRecord, EpisodeRecord, Timing, Versions
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.records.store import seal
from dohyo.evaluation.records.trajectory import Trajectory, TrajectoryRecorder
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.simulation import sumo_version

Show = Callable[[int, dict[str, Observation]], None]
"""Function called with the tick and the observations of all agents that will act."""
Watch = Callable[[float, int], None]
"""Function called with a deadline in seconds, or 0, and the number of the ego whose agent is called."""


def run_episode(
    scenario: Scenario,
    agents: Mapping[str, Agent],
    *,
    infos: Mapping[str, AgentInfo] | None = None,
    benchmark: tuple[str, str] | None = None,
    act_deadline_s: float = ACT_DEADLINE_S,
) -> EpisodeRecord:
    """Drives one scenario and returns its facts; see `drive_episode`, which also returns the trajectories."""
    return drive_episode(scenario, agents, infos=infos, benchmark=benchmark, act_deadline_s=act_deadline_s)[0]


def drive_episode(
    scenario: Scenario,
    agents: Mapping[str, Agent],
    *,
    infos: Mapping[str, AgentInfo] | None = None,
    benchmark: tuple[str, str] | None = None,
    act_deadline_s: float = ACT_DEADLINE_S,
    watch: Watch = lambda seconds, ego: None,
    show: Show | None = None,
    env: DrivingEnv | None = None,
) -> tuple[EpisodeRecord, Trajectory]:
    """Drives one scenario to the end of every ego's episode.

    A failure of an agent ends the episode of its own ego as the agent's fault. A failure of SUMO is recorded as an
    infrastructure fault. Both give a record.

    Args:
        scenario: Scenario to drive.
        agents: One agent per mission, by the name of the mission.
        infos: Description of each agent for the record; by default from the agents themselves.
        benchmark: Name and content hash of the benchmark, for the record.
        act_deadline_s: Wall-clock time allowed for one decision of an agent, s.
        watch: Function called with the deadline in seconds before every call of an agent, and with 0 after it.
        show: Function called in every tick before any agent acts, for agents that decide together in another process.
            Its errors are not failures of the agents.
        env: Environment to drive in, which is closed at the end; None: one with the sensors and controls of the agents.

    Raises:
        InvalidInputError: The scenario cannot be driven at all, or a mission has no agent.
    """
    missing = {mission.name for mission in scenario.missions} - set(agents)
    if missing:
        raise InvalidInputError(f"scenario '{scenario.name}' has no agent for {sorted(missing)}")
    env = env or agents_env(scenario, agents)
    guarded = {
        mission.name: GuardedAgent(agents[mission.name], act_deadline_s, _watched(watch, ego))
        for ego, mission in enumerate(scenario.missions)
    }
    episode = _Episode(env, scenario, guarded, show)
    try:
        episode.run()
    finally:
        env.close()
    return episode.record(infos, benchmark)


def _watched(watch: Watch, ego: int) -> Callable[[float], None]:
    return lambda seconds: watch(seconds, ego)


def agents_env(scenario: Scenario, agents: Mapping[str, Agent]) -> DrivingEnv:
    """Environment with the sensors and controls of agents.

    Raises:
        InvalidInputError: The scenario cannot be driven.
    """
    return DrivingEnv(
        scenario,
        sensors={name: agent.spec.sensors for name, agent in agents.items()},
        control={name: agent.spec.control for name, agent in agents.items()},
        reward=None,
    )


@dataclass(slots=True)
class _Drive:
    """State of one ego in the episode."""

    name: str
    index: int
    agent: GuardedAgent
    judge: Judge
    failure: str | None = None


class _Episode:
    """The loop of one episode: observe, act, tick, judge."""

    def __init__(
        self, env: DrivingEnv, scenario: Scenario, agents: Mapping[str, GuardedAgent], show: Show | None
    ) -> None:
        self.env, self.scenario, self.show = env, scenario, show
        self.drives = {
            name: _Drive(name, i, agents[name], Judge(scenario, i)) for i, name in enumerate(env.possible_agents)
        }
        self.trajectory = TrajectoryRecorder()
        self.ticks = 0
        self.began = time.perf_counter()

    def run(self) -> None:
        try:
            observations, _ = self.env.reset()
            self._start()
            while self.env.agents:
                observations = self._tick(observations)
        except SimulationError as error:
            for drive in self.drives.values():
                if drive.judge.status is None:
                    self._end(drive, Status.SIMULATION, str(error))

    def _start(self) -> None:
        self.trajectory.append(self.env.world)
        for drive in self.drives.values():
            drive.judge.start(self.env.world)
            try:
                drive.agent.reset(self.scenario.missions[drive.index], self.scenario.seed)
            except AgentFailedError as failure:
                self._end(drive, failure.status, str(failure))

    def _tick(self, observations: dict[str, Observation]) -> dict[str, Observation]:
        before = self.env.world
        if self.show is not None:
            self.show(before.tick, {name: observations[name] for name in self.env.agents})
        actions = {}
        for drive in [self.drives[name] for name in self.env.agents]:
            try:
                actions[drive.name] = self._act(drive, observations[drive.name])
            except AgentFailedError as failure:
                self._end(drive, failure.status, str(failure))
        if not actions:
            return {}
        observations = self.env.step(actions)[0]
        after = self.env.world
        self.ticks = after.tick
        self.trajectory.append(after)
        for drive in [self.drives[name] for name in actions]:
            status = drive.judge.update(before, after)
            if status is not None:
                self._end(drive, status)
        return observations

    def _act(self, drive: _Drive, observation: Observation) -> np.ndarray:
        return drive.agent.act(observation, lambda action: self.env.check_action(drive.name, action))

    def _end(self, drive: _Drive, status: Status, failure: str | None = None) -> None:
        drive.judge.end(status)
        drive.failure = failure
        if drive.name in self.env.agents:
            self.env.retire(drive.name)

    def record(
        self, infos: Mapping[str, AgentInfo] | None, benchmark: tuple[str, str] | None
    ) -> tuple[EpisodeRecord, Trajectory]:
        trajectory = self.trajectory.finish()
        wall = time.perf_counter() - self.began
        record = EpisodeRecord(
            scenario=self.scenario,
            benchmark=benchmark,
            egos=tuple(self._ego_record(drive, infos) for drive in self.drives.values()),
            ticks=self.ticks,
            versions=versions(self.env.network),
            trajectory_sha256=trajectory.sha256(),
            timing=Timing(
                created=datetime.now(UTC).isoformat(timespec="seconds"),
                wall_s=round(wall, 3),
                ticks_per_s=round(self.ticks / wall, 1),
                decision_ms={drive.name: drive.agent.decision_ms() for drive in self.drives.values()},
            ),
        )
        return seal(record), trajectory

    def _ego_record(self, drive: _Drive, infos: Mapping[str, AgentInfo] | None) -> EgoRecord:
        judge, agent, route = drive.judge, drive.agent.agent, self.env.routes[drive.index]
        entry = f"{type(agent).__module__}:{type(agent).__qualname__}"
        return EgoRecord(
            name=drive.name,
            agent=infos[drive.name] if infos else agent_info(agent, entry),
            status=judge.status or Status.SIMULATION,
            failure=drive.failure,
            duration_s=round(judge.duration_s, 3),
            route_length_m=route.length,
            progress_m=min(judge.progress_m, route.length),
            driven_m=judge.driven_m,
            outside_lanes_m=min(judge.outside_lanes_m, judge.driven_m),
            contacts=judge.contacts,
            infractions=tuple(judge.infractions),
        )


def versions(network: RoadNetwork) -> Versions:
    """Versions that produce records on this machine."""
    return Versions(dohyo=version("dohyo"), sumo=sumo_version(), network_sha256=network.sha256)
