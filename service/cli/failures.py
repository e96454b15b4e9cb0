"""End of an evaluation in which an agent failed as a program, or drives were lost: a line that stays in sight.

The scores count such failures as failed drives, and say nothing about how the agent drives.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import typer

from dohyo.evaluation.parking.record import ParkingRecord
from dohyo.evaluation.running.run import Result
from dohyo.service.cli.output import print_error

NOT_DRIVEN = 1
"""Exit code."""


@dataclass(frozen=True, slots=True)
class Failure:
    """A drive that no agent drove to its end.

    Attributes:
        agent: Name of its agent.
        drive: Name of the drive.
        reason: What failed.
    """

    agent: str
    drive: str
    reason: str


def end_driving(result: Result) -> None:
    """Ends with exit code 1 and a line for each agent that failed as a program, and one for lost drives.

    Gridlocks are no failures: they follow from the seed.
    """
    drives = [
        (ego, path.stem) for record, path in zip(result.records, result.paths, strict=True) for ego in record.egos
    ]
    failed = [
        Failure(ego.agent.name, stem, ego.failure or ego.status.value) for ego, stem in drives if ego.status.agent_fault
    ]
    lost = [stem for ego, stem in drives if ego.status.worth_another_try]
    _end(failed, len(drives), "drives", lost)


def end_parking(records: Sequence[ParkingRecord]) -> None:
    """The same for karts of lots."""
    karts = [(kart, record) for record in records for kart in record.karts]
    failed = [
        Failure(record.agent.name, f"lot {record.seed}", kart.failure or kart.ending)
        for kart, record in karts
        if kart.ending == "failed"
    ]
    _end(failed, len(karts), "karts", [])


def _end(failed: Sequence[Failure], count: int, units: str, lost: Sequence[str]) -> None:
    for agent in dict.fromkeys(one.agent for one in failed):
        mine = [one for one in failed if one.agent == agent]
        _tell(f"{agent} failed as a program in {len(mine)} of {count} {units}; {mine[0].drive}: {mine[0].reason}")
    if lost:
        _tell(f"{len(lost)} of {count} {units} lost, such as {lost[0]}; the same command drives them again")
    if failed or lost:
        raise typer.Exit(NOT_DRIVEN)


def _tell(text: str) -> None:
    """Prints on standard error, where it does not mix with a JSON document, after everything else."""
    sys.stdout.flush()
    print_error(text)
