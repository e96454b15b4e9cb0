"""Executors: distribute the episodes of an evaluation over processes. One libsumo per process.

A worker writes each record itself, so that finished records survive the death of any other process. The parent assigns
jobs and supervises: it replaces a dead worker and tries its job once more, and it ends a worker whose agent never
returns. In a mixed run the other agents then drive again without that one, as they do without an agent in whose calls
the worker died twice. A worker whose parent has died ends itself.
"""

from __future__ import annotations

import os
import signal
import threading
import time
import traceback
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from dohyo.evaluation.agent import Agent, AgentSpec, Observation, make_agent
from dohyo.evaluation.episode.runner import Watch, drive_episode, versions
from dohyo.evaluation.records.record import EgoRecord, EpisodeRecord
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.records.store import seal, write_record
from dohyo.evaluation.records.trajectory import Trajectory, TrajectoryRecorder
from dohyo.evaluation.running.job import DIED_TWICE, KILL_GRACE_S, MAX_ATTEMPTS, NEVER_RETURNED, POLL_S, Job
from dohyo.sumo_networks.errors import AgentError, AgentTimeoutError, InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.processes import worker_context, worker_process
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
        ready = wait([worker.pipe for worker in crew if worker.job], timeout=POLL_S)
        for worker in crew:
            if worker.job and (worker.pipe in ready or not worker.process.is_alive() or worker.hangs()):
                record = worker.collect(pending)
                if record is not None:
                    yield record
                worker.take(pending)


@dataclass(slots=True)
class Worker:
    """The parent's handle of one worker process."""

    job: Job | None = None
    attempt: int = 0
    pipe: Connection = field(init=False)
    process: Any = field(init=False)
    must_end_by: Synchronized[float] = field(init=False)
    called: Synchronized[int] = field(init=False)

    def __post_init__(self) -> None:
        self._start()

    def _start(self) -> None:
        context = worker_context()
        self.pipe, theirs = context.Pipe()
        self.must_end_by, self.called = context.Value("d", 0.0), context.Value("i", 0)
        self.process = worker_process(_work, theirs, self.must_end_by, self.called)
        self.process.start()
        theirs.close()

    def take(self, pending: deque[tuple[Job, int]]) -> None:
        """Begins the next job, if there is one."""
        if self.job is None and pending:
            self.job, self.attempt = pending.popleft()
            try:
                self.pipe.send(self.job)
            except OSError:  # the worker died between jobs
                self.stop()
                self._start()
                self.pipe.send(self.job)

    def hangs(self) -> bool:
        """Whether a call of the agent is past its deadline, so that the process must be ended."""
        must_end_by = self.must_end_by.value
        return self.job is not None and must_end_by > 0 and time.monotonic() > must_end_by + KILL_GRACE_S

    def collect(self, pending: deque[tuple[Job, int]]) -> EpisodeRecord | None:
        """The finished record, or one for a job that cannot be finished; None if the job will be tried again.

        Raises:
            InvalidInputError: The scenario cannot be driven.
            RecordWriteError: The record cannot be written.
        """
        job, hangs, ego, in_call = self.job, self.hangs(), self.called.value, self.must_end_by.value > 0
        assert job is not None
        answer = self._answer()
        self.job = None
        if isinstance(answer, InvalidInputError | RecordWriteError):
            raise answer
        if isinstance(answer, EpisodeRecord):
            return answer
        self.process.join(timeout=0.0 if hangs else 1.0)
        failure = answer or f"worker process ended with code {self.process.exitcode}"
        self.stop()
        self._start()
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

    def _answer(self) -> EpisodeRecord | InvalidInputError | RecordWriteError | str | None:
        """The worker's message: a record, or the reason for its absence; None if the worker died without a message."""
        try:
            return self.pipe.recv() if self.pipe.poll() else None
        except (EOFError, OSError):
            return None

    def stop(self) -> None:
        """Ends the process; an idle one by closing its pipe."""
        self.pipe.close()
        self.process.join(timeout=1.0 if self.job is None else 0.0)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()


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


def _work(pipe: Connection, must_end_by: Synchronized[float], called: Synchronized[int]) -> None:
    """A worker process: drives one job after the other until its parent closes the pipe or dies."""
    jobs: deque[Job] = deque()
    arrived = threading.Semaphore(0)

    def listen() -> None:
        while True:
            try:
                jobs.append(pipe.recv())
            except (EOFError, OSError):
                os._exit(0)
            arrived.release()

    def watch(seconds: float, ego: int) -> None:
        called.value = ego
        must_end_by.value = time.monotonic() + seconds if seconds else 0.0

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends its workers
    threading.Thread(target=listen, daemon=True).start()
    while True:
        arrived.acquire()
        job = jobs.popleft()
        try:
            record, trajectory = _drive(job, watch)
            with _writing(job.directory):
                write_record(job.directory, job.stem, record, trajectory)
            pipe.send(record)
        except InvalidInputError as error:  # a second attempt would fail too, and so would the other jobs
            pipe.send(InvalidInputError(str(error)))
        except RecordWriteError as error:  # no other record can be written either
            pipe.send(error)
        except Exception as error:  # an error of dohyo itself: the evaluation goes on, and the record states it
            traceback.print_exc()
            pipe.send(f"{type(error).__name__}: {error}")


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
            _close(agent)


def _close(agent: Agent) -> None:
    """Frees an agent's resources; its drive is over, so that a failure here must not lose it."""
    try:
        agent.close()
    except (Exception, SystemExit):
        traceback.print_exc()
