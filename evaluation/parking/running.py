"""Lots of an evaluation over processes; the drives are the same for any number of processes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any

from dohyo.evaluation.parking.agent import ParkingAgent, make_parking_agent
from dohyo.evaluation.parking.benchmark import ParkingBenchmark
from dohyo.evaluation.parking.drive import Drive, drive_lots
from dohyo.evaluation.records.record import AgentInfo
from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.processes import worker_pool

CHUNK = 25
"""Lots that a process drives before it reports."""
Tell = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Order:
    """What is driven, sent to processes.

    Attributes:
        benchmark: Benchmark of the lots.
        info: The agent.
        settings: Keyword arguments of its constructor.
    """

    benchmark: ParkingBenchmark
    info: AgentInfo
    settings: Mapping[str, Any]


def drive_all(
    order: Order,
    seeds: Sequence[int],
    workers: int,
    tell: Tell,
    keep: Callable[[Sequence[Drive]], None] = lambda chunk: None,
) -> list[Drive]:
    """Drives lots in this process, or in several.

    Args:
        order: What is driven.
        seeds: Seeds of the lots.
        workers: Number of processes; 1: this one alone.
        tell: Called with the number of lots driven and of all lots.
        keep: Called with each chunk of lots as soon as it is driven.

    Returns:
        One drive per seed, in their order.

    Raises:
        InvalidInputError: The agent cannot be made.
        SimulationError: A process died.
    """
    chunks = [seeds[first : first + CHUNK] for first in range(0, len(seeds), CHUNK)]
    if min(workers, len(chunks)) < 2:
        return _drive_here(order, chunks, len(seeds), tell, keep)
    drives: dict[int, list[Drive]] = {}
    with worker_pool(min(workers, len(chunks)), _drive) as pool:
        futures = {pool.submit(_drive, order, chunk): number for number, chunk in enumerate(chunks)}
        try:
            for future in as_completed(futures):
                drives[futures[future]] = future.result()
                keep(drives[futures[future]])
                tell(sum(map(len, drives.values())), len(seeds))
        except BrokenProcessPool as error:
            raise SimulationError(f"a process that drove '{order.info.name}' died: {error}") from error
        finally:
            pool.shutdown(cancel_futures=True)
    return [drive for number in range(len(chunks)) for drive in drives[number]]


def make_agents(benchmark: ParkingBenchmark, entry: str, settings: Mapping[str, Any]) -> list[ParkingAgent]:
    """One agent for each kart of a lot.

    Raises:
        InvalidInputError: The agent cannot be made.
    """
    return [make_parking_agent(entry, settings) for _ in range(benchmark.karts)]


def close_agents(agents: Sequence[ParkingAgent]) -> None:
    """Frees the resources of agents."""
    for agent in agents:
        if hasattr(agent, "close"):
            agent.close()


def _drive_here(
    order: Order, chunks: Sequence[Sequence[int]], total: int, tell: Tell, keep: Callable[[Sequence[Drive]], None]
) -> list[Drive]:
    drives: list[Drive] = []
    for chunk in chunks:
        before = len(drives)

        def shifted(done: int, _: int, before: int = before) -> None:
            tell(before + done, total)

        drives += _drive(order, chunk, shifted)
        keep(drives[before:])
    return drives


def _drive(order: Order, seeds: Sequence[int], tell: Tell | None = None) -> list[Drive]:
    agents = make_agents(order.benchmark, order.info.entry, order.settings)
    try:
        return drive_lots(order.benchmark, seeds, agents, order.info, tell or (lambda done, total: None))
    finally:
        close_agents(agents)
