"""Evaluation of one agent on one benchmark of parking: records, motion and report in one folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from dohyo.evaluation.agent import agent_info
from dohyo.evaluation.parking.agent import ParkingAgent, make_parking_agent
from dohyo.evaluation.parking.benchmark import ParkingBenchmark
from dohyo.evaluation.parking.drive import Drive, drive_lots
from dohyo.evaluation.parking.motion import write_motion
from dohyo.evaluation.parking.page import Evaluated, shown_records, write_parking_page
from dohyo.evaluation.parking.record import RECORDS, ParkingRecord, read_records, write_records
from dohyo.evaluation.records.record import AgentInfo, Kind
from dohyo.sumo_networks.errors import InvalidInputError

PAGE = "report.html"
Tell = Callable[[int, int], None]


def evaluate_parking(
    benchmark: ParkingBenchmark,
    entry: str,
    settings: Mapping[str, Any],
    kind: Kind,
    seeds: Sequence[int] | None,
    out: Path,
    tell: Tell = lambda done, total: None,
) -> list[ParkingRecord]:
    """Drives an agent in the lots of a benchmark; an evaluation that is complete is only read.

    Args:
        benchmark: The benchmark.
        entry: "module:Class" of the agent.
        settings: Keyword arguments of its constructor.
        kind: Its origin, for the records.
        seeds: Seeds of the lots; None: those of the benchmark.
        out: Folder of the result.
        tell: Called with the number of lots driven and of all lots.

    Raises:
        InvalidInputError: The agent cannot be made, or the folder holds another evaluation or cannot be written.
    """
    chosen = list(benchmark.seeds if seeds is None else seeds)
    agents = make_agents(benchmark, entry, settings)
    try:
        info = agent_info(agents[0], entry, settings, kind)  # type: ignore[arg-type]  # reads the spec alone
        if (out / RECORDS).exists():
            before = read_records(out / RECORDS)
            if _same(before, benchmark, info, chosen):
                return before
            raise InvalidInputError(f"'{out}' holds another evaluation of parking: choose another --out")
        if (out / "evaluation.json").exists() or (out / "result.json").exists():
            raise InvalidInputError(f"'{out}' holds an evaluation on another kind of benchmark: choose another --out")
        drives = drive_lots(benchmark, chosen, agents, info, tell)
    finally:
        close_agents(agents)
    return _written(out, drives)


def drive_again(records: Sequence[ParkingRecord], tell: Tell = lambda done, total: None) -> list[str]:
    """Drives the lots of records again; returns the new hashes, in their order.

    Args:
        records: Of one agent on one benchmark; their agent is built as they say, so that they must be trusted.
        tell: Called with the number of lots driven and of all lots.

    Raises:
        InvalidInputError: The agent cannot be made, or is another one here, or the version of dohyo is another one.
    """
    first = records[0]
    if (here := version("dohyo")) != first.version:
        raise InvalidInputError(f"the records were made by dohyo {first.version}: expected the same here, got {here}")
    agents = make_agents(first.benchmark, first.agent.entry, first.agent.settings)
    try:
        info = agent_info(agents[0], first.agent.entry, first.agent.settings, first.agent.kind)  # type: ignore[arg-type]
        if info != first.agent:
            raise InvalidInputError(f"agent '{info.name}' has changed since the records were made, or is another one")
        drives = drive_lots(first.benchmark, [one.seed for one in records], agents, info, tell)
    finally:
        close_agents(agents)
    return [drive.record.record_hash for drive in drives]


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


def _same(records: Sequence[ParkingRecord], benchmark: ParkingBenchmark, info: AgentInfo, seeds: Sequence[int]) -> bool:
    first = records[0]
    same = first.benchmark.sha256 == benchmark.sha256 and first.agent == info
    return same and [record.seed for record in records] == list(seeds)


def _written(out: Path, drives: Sequence[Drive]) -> list[ParkingRecord]:
    records = [drive.record for drive in drives]
    out.mkdir(parents=True, exist_ok=True)
    write_motion(out, drives)
    write_records(out, records)
    shown = {record.seed for record in shown_records(records)}
    motions = {drive.record.seed: drive.motion for drive in drives if drive.record.seed in shown}
    write_parking_page(out / PAGE, [Evaluated(records[0].agent.name, records, motions)])
    return records
