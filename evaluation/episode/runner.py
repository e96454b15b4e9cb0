"""run_episode: one scenario, one agent per ego, one record."""

from __future__ import annotations

import re
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np

from dohyo.evaluation.agent import Agent, Observation, agent_info
from dohyo.evaluation.criteria import ENDS, Collision, Criterion, OutsideLanes, criteria_for
from dohyo.evaluation.episode.deadline import deadline
from dohyo.evaluation.records.record import (
    AgentInfo,
    EgoRecord,
    EpisodeRecord,
    Infraction,
    InfractionKind,
    Status,
    Timing,
    Versions,
)
from dohyo.evaluation.records.store import seal
from dohyo.evaluation.records.trajectory import Trajectory, TrajectoryRecorder
from dohyo.sumo_networks.ego.control import InvalidActionError
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import AgentError, AgentTimeoutError, InvalidInputError, SimulationError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.simulation import sumo_version
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import World

ACT_DEADLINE_S = 10.0
RESET_DEADLINE_S = 60.0
LONGEST_FAILURE = 500
COLLISIONS = (
    InfractionKind.COLLISION_PEDESTRIAN,
    InfractionKind.COLLISION_STATIC,
    InfractionKind.COLLISION_VEHICLE,
)


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
    watch: Callable[[float], None] = lambda seconds: None,
    show: Callable[[int, dict[str, Observation]], None] | None = None,
) -> tuple[EpisodeRecord, Trajectory]:
    """Drives one scenario to the end of every ego's episode.

    Whatever an agent does wrong ends its own ego's episode as the agent's fault; whatever SUMO does wrong is recorded
    as an infrastructure fault. Both give a record.

    Args:
        scenario: What to drive.
        agents: One per mission, by its name.
        infos: What the record says of each agent; by default from the agents themselves.
        benchmark: Name and content hash, for the record.
        act_deadline_s: Wall-clock time an agent may take for one decision.
        watch: Called with the deadline in seconds before every call of an agent, and with 0 after it.
        show: Called in every tick before any agent acts, with the tick and the observations of all who will; for
            agents that decide together, elsewhere. Its errors are not the agents'.

    Raises:
        InvalidInputError: The scenario cannot be driven at all, or a mission has no agent.
    """
    missing = {mission.name for mission in scenario.missions} - set(agents)
    if missing:
        raise InvalidInputError(f"scenario '{scenario.name}' has no agent for {sorted(missing)}")
    # The criteria own the time limit, so that it is judged and recorded in one place.
    env = DrivingEnv(
        scenario.model_copy(update={"time_limit_s": None}),
        sensors={name: agent.spec.sensors for name, agent in agents.items()},
        control={name: agent.spec.control for name, agent in agents.items()},
        reward=None,
    )
    episode = _Episode(env, scenario, agents, act_deadline_s, watch, show)
    try:
        episode.run()
    finally:
        env.close()
    return episode.record(infos, benchmark)


@dataclass(slots=True)
class _Drive:
    """One ego's episode so far."""

    name: str
    index: int
    agent: Agent
    criteria: tuple[Criterion, ...]
    infractions: list[Infraction] = field(default_factory=list)
    latencies: list[float] = field(default_factory=list)
    progress: float = 0.0
    driven: float = 0.0
    duration: float = 0.0
    status: Status | None = None
    failure: str | None = None


class _Episode:
    """The loop of one episode: observe, act, tick, judge."""

    def __init__(
        self,
        env: DrivingEnv,
        scenario: Scenario,
        agents: Mapping[str, Agent],
        act_deadline_s: float,
        watch: Callable[[float], None],
        show: Callable[[int, dict[str, Observation]], None] | None,
    ) -> None:
        self.env, self.scenario = env, scenario
        self.act_deadline_s, self.watch, self.show = act_deadline_s, watch, show
        self.drives = {
            name: _Drive(name, i, agents[name], criteria_for(scenario)) for i, name in enumerate(env.possible_agents)
        }
        self.trajectory = TrajectoryRecorder()
        self.started = time.perf_counter()

    def run(self) -> None:
        try:
            observations, _ = self.env.reset()
            self._start()
            while self.env.agents:
                observations = self._tick(observations)
        except SimulationError as error:
            for drive in self.drives.values():
                if drive.status is None:
                    self._end(drive, Status.SIMULATION, str(error))

    def _start(self) -> None:
        world = self.env.world
        self.trajectory.append(world)
        for drive in self.drives.values():
            for criterion in drive.criteria:
                criterion.start(world, drive.index)
            mission = self.scenario.missions[drive.index]
            self._call(
                drive,
                lambda: drive.agent.reset(mission, self.scenario.seed),  # noqa: B023 - called at once
                RESET_DEADLINE_S,
                Status.AGENT_SETUP,
            )

    def _tick(self, observations: dict[str, Observation]) -> dict[str, Observation]:
        actions = {}
        if self.show is not None and self.env.agents:
            self.show(self.env.world.tick, {name: observations[name] for name in self.env.agents})
        for name in list(self.env.agents):
            action = self._act(self.drives[name], observations[name])
            if action is not None:
                actions[name] = action
        if not self.env.agents:
            return {}
        before = self.env.world
        observations, _, reached, _, _ = self.env.step(actions)
        after = self.env.world
        self.trajectory.append(after)
        for name in actions:
            self._judge(self.drives[name], before, after, reached[name])
        return observations

    def _act(self, drive: _Drive, observation: Observation) -> np.ndarray | None:
        """The agent's action, or None once its episode has ended by its own fault."""
        began = time.perf_counter()
        answer: list[np.ndarray] = []
        self._call(drive, lambda: answer.append(drive.agent.act(observation)), self.act_deadline_s, Status.AGENT_RAISED)
        if drive.status is not None:
            return None
        drive.latencies.append(time.perf_counter() - began)
        try:
            self.env.check_action(drive.name, answer[0])
        except InvalidActionError as error:
            self._end(drive, Status.AGENT_ACTION, str(error))
            return None
        return answer[0]

    def _call(self, drive: _Drive, call: Callable[[], None], seconds: float, status: Status) -> None:
        """Calls an agent; its failure ends its episode."""
        self.watch(seconds)
        try:
            with deadline(seconds, f"agent '{drive.agent.spec.name}'"):
                call()
        except AgentTimeoutError as error:
            self._end(drive, Status.AGENT_DEADLINE, str(error))
        except InvalidActionError as error:
            self._end(drive, Status.AGENT_ACTION, str(error))
        except SimulationError:  # the machine's fault, such as a policy's sandbox that cannot be started
            raise
        except AgentError as error:  # worded by whoever found the fault
            self._end(drive, status, str(error)[:LONGEST_FAILURE])
        except Exception as error:  # an agent may raise anything; the batch must survive
            self._end(drive, status, describe(error))
        finally:
            self.watch(0.0)

    def _judge(self, drive: _Drive, before: World, after: World, reached: bool) -> None:
        egos, ego = after.egos, drive.index
        drive.progress = max(drive.progress, float(egos.progress[ego]))
        drive.driven, drive.duration = float(egos.driven[ego]), after.time
        new = [found for criterion in drive.criteria for found in criterion.update(before, after, ego)]
        drive.infractions += new
        ending = next((ENDS[found.kind] for found in new if found.kind in ENDS), None)
        if self.scenario.stop_on_collision and any(found.kind in COLLISIONS for found in new):
            ending = ending or Status.COLLIDED
        if ending is not None:
            self._end(drive, ending)
        elif reached:
            self._end(drive, Status.COMPLETED)
        elif self.scenario.duration_s is not None and after.time >= self.scenario.duration_s - TICK_S / 2:
            self._end(drive, Status.FINISHED)

    def _end(self, drive: _Drive, status: Status, failure: str | None = None) -> None:
        if self.env.started:
            for criterion in drive.criteria:
                drive.infractions += criterion.finish(self.env.world, drive.index)
            drive.infractions.sort(key=lambda infraction: infraction.time_s)
        if status is Status.COMPLETED and not drive.infractions:
            status = Status.PERFECT
        drive.status, drive.failure = status, failure
        if drive.name in self.env.agents:
            self.env.retire(drive.name)

    def record(
        self, infos: Mapping[str, AgentInfo] | None, benchmark: tuple[str, str] | None
    ) -> tuple[EpisodeRecord, Trajectory]:
        network = load_network(self.scenario.network)
        trajectory = self.trajectory.finish()
        wall = time.perf_counter() - self.started
        ticks = self.env.world.tick if self.env.started else 0
        record = EpisodeRecord(
            scenario=self.scenario,
            benchmark=benchmark,
            egos=tuple(self._ego_record(drive, infos) for drive in self.drives.values()),
            ticks=ticks,
            versions=versions(network),
            trajectory_sha256=trajectory.sha256(),
            timing=Timing(
                created=datetime.now(UTC).isoformat(timespec="seconds"),
                wall_s=round(wall, 3),
                ticks_per_s=round(ticks / wall, 1),
                decision_ms={drive.name: _percentiles(drive.latencies) for drive in self.drives.values()},
            ),
        )
        return seal(record), trajectory

    def _ego_record(self, drive: _Drive, infos: Mapping[str, AgentInfo] | None) -> EgoRecord:
        collision = next(c for c in drive.criteria if isinstance(c, Collision))
        outside = next(c for c in drive.criteria if isinstance(c, OutsideLanes))
        entry = f"{type(drive.agent).__module__}:{type(drive.agent).__qualname__}"
        return EgoRecord(
            name=drive.name,
            agent=infos[drive.name] if infos else agent_info(drive.agent, entry),
            status=drive.status or Status.SIMULATION,
            failure=drive.failure,
            duration_s=round(drive.duration, 3),
            route_length_m=self.env.routes[drive.index].length,
            progress_m=min(drive.progress, self.env.routes[drive.index].length),
            driven_m=drive.driven,
            outside_lanes_m=min(outside.metres, drive.driven),
            contacts=collision.touched,
            infractions=tuple(drive.infractions),
        )


def versions(network: RoadNetwork) -> Versions:
    """What produces records here."""
    return Versions(dohyo=version("dohyo"), sumo=sumo_version(), network_sha256=network.sha256)


def describe(error: Exception) -> str:
    """Type, message and place of an error, without addresses that would differ from run to run."""
    frames = traceback.extract_tb(error.__traceback__)
    where = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
    text = f"{type(error).__name__}: {error}{where}"
    return re.sub(r"0x[0-9a-f]+", "0x", text)[:LONGEST_FAILURE]


def _percentiles(latencies: list[float]) -> tuple[float, float, float]:
    if not latencies:
        return 0.0, 0.0, 0.0
    p50, p95, p99 = np.percentile(np.array(latencies) * 1000.0, [50, 95, 99]).round(3)
    return float(p50), float(p95), float(p99)
