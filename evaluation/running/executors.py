"""Executors: distribute the episodes of an evaluation over processes. One libsumo per process.

A worker writes each record itself, so that finished records survive the death of any other process. The parent assigns
jobs and supervises: it replaces a dead worker and tries its job once more, and it ends a worker whose agent never
returns. In a mixed run the other agents then drive again without that one, as they do without an agent in whose calls
the worker died twice.
"""

from __future__ import annotations

import traceback
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import wait
from pathlib import Path
from typing import Protocol

import numpy as np

from dohyo.evaluation.agent import Agent, AgentSpec, Observation, close_agent, make_agent
from dohyo.evaluation.episode.runner import Watch, drive_episode, versions
from dohyo.evaluation.records.record import EgoRecord, EpisodeRecord
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.records.store import seal, write_record
from dohyo.evaluation.records.trajectory import Trajectory, TrajectoryRecorder
from dohyo.evaluation.running.job import DIED_TWICE, KILL_GRACE_S, MAX_ATTEMPTS, NEVER_RETURNED, POLL_S, Job
from dohyo.evaluation.running.worker import Parent, WorkerProcess
from dohyo.sumo_networks.errors import AgentError, AgentTimeoutError, InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.processes import GUARD, UNGUARDED
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission


class RecordWriteError(OSError):
    """A record cannot be written, by a full disk for example: each further episode would be driven for nothing."""


class Executor(Protocol):
    """Runs jobs, in any order, and yields each record once it is on disk."""

    def run(self, jobs: Sequence[Job]) -> Iterator[EpisodeRecord]:
        """Yields one record per job; an episode lost to the infrastructure has a record too."""


@dataclass(slots=True)
class ProcessPool:
    """Worker processes on this machine.

    Attributes:
        workers: Number of worker processes.
    """

    workers: int = 1

    def run(self, jobs: Sequence[Job]) -> Iterator[EpisodeRecord]:
        """See `Executor`.

        Raises:
            InvalidInputError: A scenario cannot be driven, or a record cannot be written.
        """
        crew = [Worker() for _ in range(min(self.workers, len(jobs)))]
        try:
            yield from drive_all(jobs, crew)
        except RecordWriteError as error:
            raise InvalidInputError(
                f"cannot write results to '{error.filename}': {error.strerror}; the same command continues"
            ) from error
        finally:
            for worker in crew:
                worker.stop()


def drive_all(jobs: Sequence[Job], crew: Sequence[Worker]) -> Iterator[EpisodeRecord]:
    """Distributes jobs over worker processes, which stay alive; yields one record per job, as `Executor` does.

    Raises:
        InvalidInputError: A scenario cannot be driven.
        RecordWriteError: A record cannot be written.
    """
    pending = deque((job, 1) for job in jobs)
    for worker in crew:
        worker.take(pending)
    while any(worker.job for worker in crew):
        ready = wait([worker.process.pipe for worker in crew if worker.job], timeout=POLL_S)
        for worker in crew:
            if worker.job and (worker.process.pipe in ready or worker.process.is_dead() or worker.hangs()):
                record = worker.collect(pending)
                if record is not None:
                    yield record
                worker.take(pending)


@dataclass(slots=True)
class Worker:
    """A worker process with its present job.

    Attributes:
        process: The process.
        job: Its job; None while it is idle.
        attempt: How often the job has been tried, this time included.
    """

    process: WorkerProcess = field(default_factory=lambda: WorkerProcess(_work))
    job: Job | None = None
    attempt: int = 0

    def take(self, pending: deque[tuple[Job, int]]) -> None:
        """Begins the next job, if there is one."""
        if self.job is None and pending:
            self.job, self.attempt = pending.popleft()
            self.process.send(self.job)

    def hangs(self) -> bool:
        """Whether a call of the agent is past its deadline, so that the process must be ended."""
        return self.job is not None and self.process.is_overdue(KILL_GRACE_S)

    def collect(self, pending: deque[tuple[Job, int]]) -> EpisodeRecord | None:
        """The finished record, or one for a job that cannot be finished; None if the job will be tried again.

        Raises:
            InvalidInputError: The scenario cannot be driven.
            RecordWriteError: The record cannot be written.
        """
        job, hangs, ego, in_call = self.job, self.hangs(), self.process.called, self.process.in_call
        assert job is not None
        answer: EpisodeRecord | InvalidInputError | RecordWriteError | str | None = self.process.answer()
        self.job = None
        if isinstance(answer, InvalidInputError | RecordWriteError):
            raise answer
        if isinstance(answer, EpisodeRecord):
            return answer
        if answer is None and not hangs and self.process.exit_code == UNGUARDED:
            raise InvalidInputError(GUARD)
        failure = answer or ("" if hangs else f"worker process ended with code {self.process.exit_code}")
        self.process.replace()
        if hangs:
            if (others := job.without(ego, NEVER_RETURNED)) is None:
                return _lost(job, Status.AGENT_DEADLINE, NEVER_RETURNED)
            pending.append((others, self.attempt))
            return None
        following = job.after_death(ego) if in_call and answer is None else None
        if following is not None and following.suspect is None:
            pending.append((following, 1))
            return None
        if self.attempt < MAX_ATTEMPTS:
            pending.append((following or job, self.attempt + 1))
            return None
        return _lost(job, Status.SIMULATION, failure)

    def stop(self) -> None:
        """Ends the process."""
        self.process.stop(patience_s=1.0 if self.job is None else 0.0)


def lost_episode(job: Job, status: Status, failure: str) -> EpisodeRecord:
    """Writes the record of an episode whose process died before it wrote one.

    Raises:
        OSError: The record cannot be written.
    """
    network = load_network(job.scenario.network)
    egos = tuple(
        EgoRecord(
            name=mission.name,
            agent=job.infos[mission.name],
            status=status,
            failure=failure,
            duration_s=0.0,
            route_length_m=plan_route(network, mission).length,
            progress_m=0.0,
            driven_m=0.0,
        )
        for mission in job.scenario.missions
    )
    trajectory = TrajectoryRecorder().finish()
    record = EpisodeRecord(
        scenario=job.scenario,
        benchmark=job.benchmark,
        egos=egos,
        ticks=0,
        versions=versions(network),
        trajectory_sha256=trajectory.sha256(),
    )
    record = seal(record)
    write_record(job.directory, job.stem, record, trajectory)
    return record


def _lost(job: Job, status: Status, failure: str) -> EpisodeRecord:
    with _writing(job.directory):
        return lost_episode(job, status, failure)


@contextmanager
def _writing(directory: Path) -> Iterator[None]:
    """An OSError of the block becomes a RecordWriteError with the folder's name."""
    try:
        yield
    except OSError as error:
        raise RecordWriteError(error.errno, error.strerror or str(error), str(directory)) from error


def _work(parent: Parent) -> None:
    """A worker process: drives one job after the other."""
    for job in parent.jobs():
        try:
            record, trajectory = _drive(job, parent.watch)
            with _writing(job.directory):
                write_record(job.directory, job.stem, record, trajectory)
            parent.send(record)
        except InvalidInputError as error:  # a second attempt would fail too, and so would the other jobs
            parent.send(InvalidInputError(str(error)))
        except RecordWriteError as error:  # no other record can be written either
            parent.send(error)
        except Exception as error:  # an error of dohyo itself: the evaluation goes on, and the record states it
            traceback.print_exc()
            parent.send(f"{type(error).__name__}: {error}")


class Hung(Agent):
    """Stands for an agent that ended with its process: it fails at once, as that one did."""

    spec = AgentSpec(name="hung", track="sensors", sensors=("speedometer",), control="lane_command")

    def __init__(self, why: str) -> None:
        """Stores the reason."""
        self._why = why

    def reset(self, mission: Mission, seed: int) -> None:
        """Raises AgentTimeoutError, unless the agent's process died."""
        if self._why != DIED_TWICE:
            raise AgentTimeoutError(self._why)

    def act(self, observation: Observation) -> np.ndarray:
        """Raises AgentError."""
        raise AgentError(self._why)

    def close(self) -> None:
        """Does nothing: it holds no resources."""


def drive_job(job: Job, watch: Watch = lambda seconds, ego: None) -> EpisodeRecord:
    """Drives one job in this process and writes its record.

    Raises:
        InvalidInputError: The scenario cannot be driven.
        OSError: The record cannot be written.
    """
    record, trajectory = _drive(job, watch)
    write_record(job.directory, job.stem, record, trajectory)
    return record


def _drive(job: Job, watch: Watch) -> tuple[EpisodeRecord, Trajectory]:
    agents = {
        name: Hung(job.hung[name]) if name in job.hung else make_agent(info.entry, info.settings)
        for name, info in job.infos.items()
    }
    try:
        return drive_episode(
            job.scenario,
            agents,
            infos=job.infos,
            benchmark=job.benchmark,
            act_deadline_s=job.act_deadline_s,
            watch=watch,
        )
    finally:
        for agent in agents.values():
            close_agent(agent)
