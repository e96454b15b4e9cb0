"""Lots of an evaluation over processes; the drives are the same for any number of processes.

A process drives chunks of lots and sends each drive as soon as it ends. One that dies is replaced, and its lot is tried
once more; one whose agent never returns is ended. A lot in which the process was ended, or died twice while the agent
was called, is recorded as failed, and the others go on.
"""

from __future__ import annotations

import traceback
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import wait
from typing import Any

from dohyo.evaluation.episode.guarded_agent import ACT_DEADLINE_S
from dohyo.evaluation.parking.agent import FailedAgent, ParkingAgent, make_parking_agent
from dohyo.evaluation.parking.benchmark import ParkingBenchmark
from dohyo.evaluation.parking.deadlines import Deadlines, Limit, unlimited
from dohyo.evaluation.parking.drive import Drive, drive_lots
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.running.job import DIED_TWICE, KILL_GRACE_S, MAX_ATTEMPTS, NEVER_RETURNED, POLL_S
from dohyo.evaluation.running.worker import Parent, WorkerProcess
from dohyo.sumo_networks.errors import DohyoError, SimulationError

CHUNK = 25
"""Lots that a process drives before they are kept."""
Tell = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Order:
    """What is driven, sent to processes.

    Attributes:
        benchmark: Benchmark of the lots.
        info: The agent.
        settings: Keyword arguments of its constructor.
        act_deadline_s: Wall-clock time allowed for one decision, s.
    """

    benchmark: ParkingBenchmark
    info: AgentInfo
    settings: Mapping[str, Any]
    act_deadline_s: float = ACT_DEADLINE_S


def drive_all(
    order: Order,
    seeds: Sequence[int],
    workers: int,
    tell: Tell,
    keep: Callable[[Sequence[Drive]], None] = lambda chunk: None,
) -> list[Drive]:
    """Drives lots in processes of their own, which an agent may end or keep busy for ever.

    Args:
        order: What is driven.
        seeds: Seeds of the lots, each once.
        workers: Number of processes.
        tell: Called with the number of lots driven and of all lots.
        keep: Called with each chunk of lots as soon as it is driven.

    Returns:
        One drive per seed, in their order.

    Raises:
        InvalidInputError: The agent cannot be made.
        SimulationError: A process died twice in a lot while no agent was called.
    """
    chunks = deque(seeds[first : first + CHUNK] for first in range(0, len(seeds), CHUNK))
    crew = [_Worker(order) for _ in range(min(workers, len(chunks)))]
    driven: dict[int, Drive] = {}
    try:
        for worker in crew:
            worker.take(chunks)
        while busy := [worker for worker in crew if worker.left]:
            wait([worker.process.pipe for worker in busy], timeout=POLL_S)
            for worker in busy:
                for drive in worker.collect():
                    driven[drive.record.seed] = drive
                    tell(len(driven), len(seeds))
                if not worker.left:
                    keep(worker.drives)
                    worker.take(chunks)
    finally:
        for worker in crew:
            worker.process.stop(patience_s=0.0 if worker.left else 1.0)
    return [driven[seed] for seed in seeds]


def drive_here(order: Order, seeds: Sequence[int]) -> Iterator[Drive]:
    """Drives lots in this process, one after the other; an agent that ends the process ends this one.

    Raises:
        InvalidInputError: The agent cannot be made.
    """
    return _drives(order, seeds, Deadlines(order.act_deadline_s).limit)


def make_agents(benchmark: ParkingBenchmark, entry: str, settings: Mapping[str, Any]) -> list[ParkingAgent]:
    """One agent for each kart of a lot.

    Raises:
        InvalidInputError: The agent cannot be made.
    """
    return [make_parking_agent(entry, settings) for _ in range(benchmark.karts)]


def close_agents(agents: Sequence[ParkingAgent], limit: Limit = unlimited) -> None:
    """Frees the resources of agents; their drives are over, so that a failure here must not lose them."""
    for number, agent in enumerate(agents):
        try:
            with limit("close", number, agent):
                if hasattr(agent, "close"):
                    agent.close()
        except (Exception, SystemExit):
            traceback.print_exc()


@dataclass(slots=True)
class _Worker:
    """A process with its present chunk.

    Attributes:
        order: What is driven.
        process: The process.
        left: Seeds of the chunk's lots that are not driven yet; the process drives the first one.
        drives: Drives of the chunk so far.
        attempt: How often the first lot that is left has been tried, this time included.
    """

    order: Order
    process: WorkerProcess = field(default_factory=lambda: WorkerProcess(_work))
    left: Sequence[int] = ()
    drives: list[Drive] = field(default_factory=list)
    attempt: int = 1

    def take(self, chunks: deque[Sequence[int]]) -> None:
        """Begins the next chunk, if there is one."""
        if chunks:
            self.left, self.drives, self.attempt = chunks.popleft(), [], 1
            self.process.send((self.order, self.left))

    def collect(self) -> Iterator[Drive]:
        """Yields the drives that have arrived, and one that stands for the lot in which the process ended.

        Raises:
            InvalidInputError: The agent cannot be made.
            SimulationError: The process died twice in a lot while no agent was called.
        """
        hangs, arrived = self.process.is_overdue(KILL_GRACE_S), False
        while self.left and (answer := self.process.answer()) is not None:
            if isinstance(answer, DohyoError):
                raise answer
            arrived = True
            yield self._driven(answer)
        if self.left and not arrived and (hangs or self.process.is_dead()):
            yield from self._ended(hangs)

    def _ended(self, hangs: bool) -> Iterator[Drive]:
        """Goes on in another process: tries the lot again, or yields a failed drive in its place."""
        in_call, code = self.process.in_call, None if hangs else self.process.exit_code
        self.process.replace()
        if hangs:
            yield self._driven(_failed(self.order, self.left[0], NEVER_RETURNED))
        elif self.attempt < MAX_ATTEMPTS:
            self.attempt += 1
        elif in_call:
            yield self._driven(_failed(self.order, self.left[0], DIED_TWICE))
        else:
            name, seed = self.order.info.name, self.left[0]
            raise SimulationError(f"the process that drove '{name}' in lot {seed} died twice, with exit code {code}")
        if self.left:
            self.process.send((self.order, self.left))

    def _driven(self, drive: Drive) -> Drive:
        self.left, self.attempt = self.left[1:], 1
        self.drives.append(drive)
        return drive


def _failed(order: Order, seed: int, why: str) -> Drive:
    """The drive in a lot whose agents failed before they began."""
    agents = [FailedAgent(why)] * order.benchmark.karts
    return next(drive_lots(order.benchmark, [seed], agents, order.info))


def _work(parent: Parent) -> None:
    """A worker process: drives one chunk after the other, each with new agents."""
    deadlines: Deadlines | None = None
    for order, seeds in parent.jobs():
        deadlines = deadlines or Deadlines(order.act_deadline_s, parent.watch)
        try:
            for drive in _drives(order, seeds, deadlines.limit):
                if drive.record.seed != seeds[-1]:
                    parent.send(drive)
            parent.send(drive)  # with its agents closed, since the parent may end an idle process
        except DohyoError as error:
            parent.send(error)
        except Exception as error:  # an error of dohyo itself
            traceback.print_exc()
            parent.send(SimulationError(f"{type(error).__name__}: {error}"))


def _drives(order: Order, seeds: Sequence[int], limit: Limit) -> Iterator[Drive]:
    agents = make_agents(order.benchmark, order.info.entry, order.settings)
    try:
        yield from drive_lots(order.benchmark, seeds, agents, order.info, limit)
    finally:
        close_agents(agents, limit)
