"""RayExecutor: distributes an evaluation over a Ray cluster. Ray is the extra `cluster`, imported only when it is used.

On each machine, small Ray actors have one worker process each. It is the worker of the process pool, which handles
failures of agents and deaths of workers. A job that Ray loses with an actor or a machine is tried once more elsewhere.
Ray may lose an answer for ever where a link was down; so the driver asks actors whether they still drive. Machines need
not share a disk: actors send records and trajectories, and the driver writes them.
"""

from __future__ import annotations

import dataclasses
import os
import socket
import sys
import tempfile
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from dohyo.evaluation.episode.runner import versions
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.records.store import read_trajectory, write_record
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.evaluation.running.executors import Worker, drive_all, lost_episode
from dohyo.evaluation.running.job import MAX_ATTEMPTS, Job
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.networks.catalog import load_network

CONNECT_S = 10.0
BEAT_S = 10.0
"""Time between two checks of the actors that drive."""
SILENCE_S = 30.0
"""Time that an actor has for the answer to a check."""
GRACE_S = 5.0
"""Time that the answer to a call may take after the end of that call."""
LOCAL = "local"
LOCAL_CLUSTER = {"include_dashboard": False, "_system_config": {"worker_niceness": 0}}
"""Options of a cluster on this machine; Ray's niceness of 15 would let other programs make agents miss deadlines."""
THREADS = "OMP_NUM_THREADS"
NO_ANSWER = "an actor drives no more and gives no answer"


@dataclass(frozen=True, slots=True)
class RayExecutor:
    """Worker processes on the machines of a Ray cluster.

    All machines need the same versions of dohyo, Ray, Python and the agent's module. The versions of dohyo, SUMO and
    the network are compared; the agent's code is not.

    Attributes:
        address: Address of the cluster, as for `ray.init`; None: a new cluster on this machine.
        workers: Number of workers; None: one per CPU of the cluster.
    """

    address: str | None = None
    workers: int | None = None

    def __post_init__(self) -> None:
        """Raises InvalidInputError where Ray is not installed."""
        require_ray()

    def run(self, jobs: Sequence[Job]) -> Iterator[EpisodeRecord]:
        """See `Executor`.

        Raises:
            InvalidInputError: There is no such cluster, a machine of it has another version of dohyo, or a scenario
                cannot be driven.
            SimulationError: The cluster cannot start a worker.
        """
        if not jobs:
            return
        ray = require_ray()
        ours = not ray.is_initialized()
        if ours:
            connect(ray, self.address)
        try:
            count = self.workers or max(1, int(ray.cluster_resources().get("CPU", 1)))
            yield from _Crew(ray, min(count, len(jobs))).run(jobs)
        finally:
            if ours:
                ray.shutdown()


def require_ray() -> Any:
    """The module `ray`.

    Raises:
        InvalidInputError: Ray is not installed.
    """
    if find_spec("ray") is None:
        raise InvalidInputError("executor 'ray' needs the package ray: pip install 'dohyo[cluster]'")
    return import_module("ray")


def connect(ray: Any, address: str | None) -> None:
    """Connects this process to a cluster as its driver.

    Raises:
        InvalidInputError: There is no such cluster.
    """
    if address is not None:
        _knock(address)
    try:
        ray.init(
            address=address or LOCAL,
            namespace="dohyo",
            log_to_driver=False,
            logging_level="error",
            **({} if address else LOCAL_CLUSTER),
        )
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise InvalidInputError(f"no Ray cluster at '{address or LOCAL}': {first_line(error)}") from error


def _knock(address: str) -> None:
    """Refuses an address at which nothing listens; Ray would try for minutes."""
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if not colon or not port.isdigit():
        return  # such as "auto"
    try:
        socket.create_connection((host, int(port)), CONNECT_S).close()
    except OSError as error:
        raise InvalidInputError(f"no Ray cluster at '{address}': {error.strerror or error}") from error


class _Crew:
    """The driver's handles of the actors."""

    def __init__(self, ray: Any, count: int) -> None:
        self._ray = ray
        self._actor = as_actor(ray, Station)
        self._checked = time.monotonic()
        self._tasks: dict[
            Any, tuple[Any, Job | None, int]
        ] = {}  # by Ray's reference to the result: actor, its job, attempt
        self._failed_starts = 0
        for _ in range(count):
            self._start_actor()

    def run(self, jobs: Sequence[Job]) -> Iterator[EpisodeRecord]:
        """Yields one record per job."""
        pending = deque((job, 1) for job in jobs)
        left = len(jobs)
        try:
            while left:
                answers = self._ray.wait(list(self._tasks), timeout=BEAT_S)[0]
                for record in (*(self._collect(one, pending) for one in answers), *self._give_up_lost(pending)):
                    if record is not None:
                        left -= 1
                        yield record
        finally:
            for actor, _, _ in self._tasks.values():
                self._ray.kill(actor)

    def _start_actor(self) -> None:
        actor = self._actor.remote(tuple(sys.path), os.environ.get(THREADS))
        self._tasks[actor.ready.remote()] = (actor, None, 0)

    def _collect(self, answer: Any, pending: deque[tuple[Job, int]]) -> EpisodeRecord | None:
        """The record of a job that has ended, if any; assigns the next job to its actor."""
        actor, job, attempt = self._tasks.pop(answer)
        try:
            result = self._ray.get(answer)
        except self._ray.exceptions.RayError as error:
            cause = getattr(error, "cause", None)
            if isinstance(cause, InvalidInputError):
                raise InvalidInputError(str(cause)) from None
            self._ray.kill(actor)
            return self._without_actor(job, attempt, pending, first_line(error))
        if pending:
            following, tries = pending.popleft()
            self._tasks[actor.drive.remote(following)] = (actor, following, tries)
        else:
            self._ray.kill(actor)
        return None if job is None else write_here(job, *result)

    def _give_up_lost(self, pending: deque[tuple[Job, int]]) -> Iterator[EpisodeRecord | None]:
        """Ends actors whose answer will never come, as if Ray had said so."""
        if time.monotonic() < self._checked + BEAT_S:
            return
        driving = {call: actor for call, (actor, job, _) in self._tasks.items() if job is not None}
        for call in lost_calls(self._ray, driving):
            actor, job, attempt = self._tasks.pop(call)
            self._ray.kill(actor)
            yield self._without_actor(job, attempt, pending, NO_ANSWER)
        self._checked = time.monotonic()

    def _without_actor(
        self, job: Job | None, attempt: int, pending: deque[tuple[Job, int]], reason: str
    ) -> EpisodeRecord | None:
        """Tries the job of an actor that Ray has lost once more, or returns the record of a lost episode."""
        if job is None:
            self._failed_starts += 1
            if self._failed_starts > MAX_ATTEMPTS:
                raise SimulationError(f"the Ray cluster cannot start a worker: {reason}")
        elif attempt < MAX_ATTEMPTS:
            pending.append((job, attempt + 1))
        self._start_actor()
        if job is None or attempt < MAX_ATTEMPTS:
            return None
        return lost_episode(job, Status.SIMULATION, f"Ray lost its worker: {reason}")


def as_actor(ray: Any, actor: type[ClusterActor]) -> Any:
    """A class of Ray actors, which answer checks while they drive."""
    return ray.remote(num_cpus=1, max_restarts=0, max_concurrency=2)(actor)


def lost_calls(ray: Any, calls: Mapping[Any, Any]) -> list[Any]:
    """Calls of actors that will never be answered.

    After a link was down for a while, Ray may know an actor as alive and never deliver its answer.

    Args:
        ray: The module.
        calls: Actor of each call, by Ray's reference to the result.

    Returns:
        Calls whose actor does not answer a check, or has ended them without an answer here.
    """
    checks = {call: actor.has_ended.remote(call.task_id().hex()) for call, actor in calls.items()}
    if checks:
        ray.wait(list(checks.values()), num_returns=len(checks), timeout=SILENCE_S)
    ended = [call for call, check in checks.items() if _is_ended(ray, check)]
    return ray.wait(ended, num_returns=len(ended), timeout=GRACE_S)[1] if ended else []


def _is_ended(ray: Any, check: Any) -> bool:
    """What a check says; True if it says nothing."""
    try:
        return bool(ray.get(check, timeout=0))
    except ray.exceptions.RayError:  # too late, or the actor is lost
        return True


class ClusterActor:
    """Ray actor that finds the modules of its driver, and answers while a call runs."""

    def __init__(self, search_path: Sequence[str], threads: str | None) -> None:
        """Prepares the process.

        Args:
            search_path: Python path of the driver, so that the process finds the same modules if this machine has them.
            threads: OMP_NUM_THREADS of the driver. Ray sets another, on which the last bits of a policy may depend.
        """
        os.environ.pop(THREADS, None)
        if threads is not None:
            os.environ[THREADS] = threads
        sys.path += [entry for entry in search_path if entry not in sys.path and Path(entry).exists()]
        self._ended = set[str]()

    def ready(self) -> None:
        """Returns once the actor is running."""

    def has_ended(self, call: str) -> bool:
        """Whether a call that drives has ended, by the identifier of its task."""
        return call in self._ended

    @contextmanager
    def ending(self) -> Iterator[None]:
        """Notes the end of the call around it."""
        try:
            yield
        finally:
            self._ended.add(require_ray().get_runtime_context().get_task_id())


class Station(ClusterActor):
    """Actor with one worker process; it returns records as values instead of files."""

    def __init__(self, search_path: Sequence[str], threads: str | None) -> None:
        """See `ClusterActor`; starts the worker process."""
        super().__init__(search_path, threads)
        self._worker = Worker()

    def drive(self, job: Job) -> tuple[EpisodeRecord, dict[str, Any]]:
        """Drives one job.

        Returns:
            The record of the job, and the fields of its trajectory.
        """
        with self.ending(), tempfile.TemporaryDirectory(prefix="dohyo-") as folder:
            here = dataclasses.replace(job, directory=Path(folder))
            (record,) = drive_all([here], [self._worker])
            trajectory = read_trajectory(here.directory / f"{here.stem}.json")
        columns = {field.name: getattr(trajectory, field.name) for field in dataclasses.fields(trajectory)}
        return record, columns | {"names": dict(trajectory.names)}


def write_here(job: Job, record: EpisodeRecord, columns: dict[str, Any]) -> EpisodeRecord:
    """Writes a record from another machine to the driver's folder.

    Raises:
        InvalidInputError: The record was made by other versions than those on this machine.
    """
    here = versions(load_network(job.scenario.network))
    if record.versions != here:
        raise InvalidInputError(f"a machine of the Ray cluster has other versions: {record.versions}, here {here}")
    write_record(job.directory, job.stem, record, Trajectory(**columns))
    return record


def first_line(error: Exception) -> str:
    """Type and beginning of an error of Ray, whose messages are pages long."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return f"{type(error).__name__}: {lines[0] if lines else ''}"[:300]
