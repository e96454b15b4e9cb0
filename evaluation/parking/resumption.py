"""Resumption: an evaluation keeps its lots chunk by chunk, and a later run drives the missing ones alone.

Each chunk is a folder of records and motion in `driven/`; its records are written last, so that a folder without them
is no chunk. The chunks stay until all final files are written: while there are some, those files may be old or missing.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path

from dohyo.evaluation.parking.benchmark import ParkingBenchmark
from dohyo.evaluation.parking.drive import Drive
from dohyo.evaluation.parking.motion import read_motion, write_motion
from dohyo.evaluation.parking.record import RECORDS, ParkingRecord, read_records, write_records
from dohyo.evaluation.records.record import AgentInfo
from dohyo.sumo_networks.errors import InvalidInputError

DRIVEN = "driven"


def keep(out: Path, drives: Sequence[Drive]) -> None:
    """Keeps a chunk of an evaluation in its result folder.

    Raises:
        InvalidInputError: The files cannot be written.
    """
    folder = out / DRIVEN / str(drives[0].record.seed)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInputError(f"cannot write '{folder}': {error.strerror}") from error
    write_motion(folder, drives)
    write_records(folder, [drive.record for drive in drives])


def kept(out: Path, benchmark: ParkingBenchmark, info: AgentInfo, seeds: Sequence[int]) -> dict[int, Drive]:
    """Drives of earlier runs by seed, without those of another version of dohyo.

    Args:
        out: Result folder.
        benchmark: Benchmark of the evaluation.
        info: Agent of the evaluation.
        seeds: Lots of the evaluation.

    Raises:
        InvalidInputError: The folder holds another benchmark, agent or other lots, or a file in it is damaged.
    """
    wanted, found = set(seeds), dict[int, Drive]()
    for folder in _folders(out):
        records = read_records(folder / RECORDS)
        _check_continues(out, records[0], benchmark, info)
        if others := [record.seed for record in records if record.seed not in wanted]:
            raise InvalidInputError(f"'{out}' holds lot {others[0]}, which is not to be driven: choose another --out")
        # Beside records of another version may lie the motion of this one, from a run that ended between the two.
        current = [one for one in records if one.version == version("dohyo")]
        motions = read_motion(folder, current)
        found |= {record.seed: Drive(record, motions[record.seed]) for record in current if record.seed in motions}
    return found


def are_chunks_left(out: Path) -> bool:
    """Whether a run ended before all final files of its evaluation were written."""
    return (out / DRIVEN).exists()


def forget_chunks(out: Path) -> None:
    """Removes the chunks of an evaluation whose final files are all written."""
    shutil.rmtree(out / DRIVEN, ignore_errors=True)


def _folders(out: Path) -> Iterator[Path]:
    """The result folder and its chunks, those that have records."""
    for folder in (out, *sorted((out / DRIVEN).glob("*"))):
        if (folder / RECORDS).exists():
            yield folder


def _check_continues(out: Path, there: ParkingRecord, benchmark: ParkingBenchmark, info: AgentInfo) -> None:
    if there.benchmark.sha256 != benchmark.sha256:
        raise InvalidInputError(
            f"'{out}' holds benchmark {there.benchmark.name} {there.benchmark.sha256[:8]}, not {benchmark.name} "
            f"{benchmark.sha256[:8]}; choose another --out"
        )
    if there.agent != info:
        raise InvalidInputError(
            f"'{out}' holds agent '{there.agent.name}' as it was before its code or settings changed, or another "
            "agent; choose another --out"
        )
