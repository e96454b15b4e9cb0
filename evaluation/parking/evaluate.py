"""Evaluation of one agent on one benchmark of parking: records, motion and report in one folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from dohyo.evaluation.agent import agent_info
from dohyo.evaluation.agent_files import note_files
from dohyo.evaluation.episode.guarded_agent import ACT_DEADLINE_S
from dohyo.evaluation.families import OtherFamilyError
from dohyo.evaluation.parking.agent import make_parking_agent
from dohyo.evaluation.parking.benchmark import ParkingBenchmark
from dohyo.evaluation.parking.drive import Drive
from dohyo.evaluation.parking.motion import write_motion
from dohyo.evaluation.parking.page import Evaluated, dohyo_versions, shown_records, write_parking_page
from dohyo.evaluation.parking.record import ParkingRecord, write_records
from dohyo.evaluation.parking.resumption import are_chunks_left, forget_chunks, keep, kept
from dohyo.evaluation.parking.running import Order, Tell, close_agents, drive_all, drive_here
from dohyo.evaluation.records.record import AgentInfo, Kind
from dohyo.evaluation.running.lock import held
from dohyo.sumo_networks.errors import InvalidInputError

PAGE = "report.html"


def evaluate_parking(
    benchmark: ParkingBenchmark,
    entry: str,
    settings: Mapping[str, Any],
    kind: Kind,
    seeds: Sequence[int] | None,
    out: Path,
    workers: int = 1,
    tell: Tell = lambda done, total: None,
    act_deadline_s: float = ACT_DEADLINE_S,
    note: Callable[[str], None] = lambda text: None,
) -> list[ParkingRecord]:
    """Drives an agent in the lots of a benchmark; a second call drives the missing lots and writes the missing files.

    Args:
        benchmark: The benchmark.
        entry: "module:Class" of the agent.
        settings: Keyword arguments of its constructor.
        kind: Its origin, for the records.
        seeds: Seeds of the lots; None: those of the benchmark.
        out: Folder of the result.
        workers: Number of processes.
        tell: Called with the number of lots driven and of all lots.
        act_deadline_s: Wall-clock time allowed for one decision, s.
        note: Called with one line for each file among the settings that the records do not name.

    Raises:
        InvalidInputError: A lot comes twice, the agent cannot be made, or the folder is in use, holds another
            evaluation or cannot be written.
        SimulationError: A process died twice in a lot while no agent was called.
    """
    chosen = list(benchmark.seeds if seeds is None else seeds)
    if len(set(chosen)) < len(chosen):
        raise InvalidInputError(
            f"benchmark '{benchmark.name}': expected every lot once, got {len(chosen)} seeds of {len(set(chosen))} lots"
        )
    try:
        info = _info(entry, settings, kind, note)
    except OtherFamilyError as error:
        raise InvalidInputError(f"benchmark '{benchmark.name}': {error}") from error
    if (out / "evaluation.json").exists() or (out / "result.json").exists():
        raise InvalidInputError(f"'{out}' holds an evaluation on another kind of benchmark: choose another --out")
    with held(out, read_only=True):
        driven = kept(out, benchmark, info, chosen)
        missing = [seed for seed in chosen if seed not in driven]
        if missing:
            done, total = len(driven), len(chosen)
            drives = drive_all(
                *(Order(benchmark, info, settings, act_deadline_s), missing, workers),
                tell=lambda more, _: tell(done + more, total),
                keep=lambda chunk: keep(out, chunk),
            )
            driven |= {drive.record.seed: drive for drive in drives}
        if missing or are_chunks_left(out) or not (out / PAGE).exists():
            _write(out, [driven[seed] for seed in chosen])
            forget_chunks(out)
    return [driven[seed].record for seed in chosen]


def drive_again(
    records: Sequence[ParkingRecord],
    workers: int | None = None,
    tell: Tell = lambda done, total: None,
    more: Mapping[str, Any] | None = None,
    act_deadline_s: float = ACT_DEADLINE_S,
) -> list[str]:
    """Drives the lots of records again; returns the new hashes, in their order.

    Args:
        records: Of one agent on one benchmark; their agent is built as they say, so that they must be trusted.
        workers: Number of processes; None: this one alone, where none can be started.
        tell: Called with the number of lots driven and of all lots.
        more: Keyword arguments of the agent's constructor besides those in the records, such as the path of a policy.
        act_deadline_s: Wall-clock time allowed for one decision, s.

    Raises:
        InvalidInputError: The agent cannot be made, or is another one here, or the version of dohyo is another one.
        SimulationError: A process died twice in a lot while no agent was called.
    """
    first = records[0]
    if (made := dohyo_versions(records)) != (here := version("dohyo")):
        raise InvalidInputError(f"the records were made by dohyo {made}: expected the same here, got {here}")
    settings = {**first.agent.settings, **(more or {})}
    info = _info(first.agent.entry, settings, first.agent.kind).model_copy(update={"settings": first.agent.settings})
    if info != first.agent:
        raise InvalidInputError(f"agent '{info.name}' has changed since the records were made, or is another one")
    order, seeds = Order(first.benchmark, info, settings, act_deadline_s), [one.seed for one in records]
    drives = drive_here(order, seeds) if workers is None else drive_all(order, seeds, workers, tell)
    return [drive.record.record_hash for drive in drives]


def _info(
    entry: str, settings: Mapping[str, Any], kind: Kind, note: Callable[[str], None] = lambda text: None
) -> AgentInfo:
    """Description of an agent, which is made for it."""
    agent = make_parking_agent(entry, settings)
    try:
        note_files(agent, settings, note)
        return agent_info(agent, entry, settings, kind)  # type: ignore[arg-type]  # it reads the spec alone
    finally:
        close_agents([agent])


def _write(out: Path, drives: Sequence[Drive]) -> None:
    """Writes the final files of an evaluation, each complete or not at all."""
    records = [drive.record for drive in drives]
    write_motion(out, drives)
    write_records(out, records)
    shown = {record.seed for record in shown_records(records)}
    motions = {drive.record.seed: drive.motion for drive in drives if drive.record.seed in shown}
    write_parking_page(out / PAGE, [Evaluated(records[0].agent.name, records, motions)])
