"""`dohyo evaluate`, `dohyo verify` and `dohyo report` on the benchmarks of parking."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import typer

from dohyo.agents.registry import kind_of, resolve
from dohyo.evaluation.parking.benchmark import load_parking_benchmark
from dohyo.evaluation.parking.evaluate import PAGE, drive_again, evaluate_parking
from dohyo.evaluation.parking.lot_files import is_lots_folder, part_of_lots, read_lot_motions, read_lots
from dohyo.evaluation.parking.motion import read_motion
from dohyo.evaluation.parking.page import (
    Evaluated,
    Motions,
    comparisons,
    mixed_versions,
    shown_records,
    write_parking_page,
)
from dohyo.evaluation.parking.record import RECORDS, ParkingRecord, read_records
from dohyo.evaluation.parking.result import MEASURES, summarise_parking
from dohyo.service.cli.by_agent import names_in_report
from dohyo.service.cli.failures import end_parking
from dohyo.service.cli.output import console, interval, print_error, print_json, print_part, print_rows
from dohyo.service.cli.progress import ProgressBar
from dohyo.service.cli.trust import check_trusted
from dohyo.service.parking.interface import POLICY as PARKER
from dohyo.service.policies.agent import NAME as ONNX
from dohyo.sumo_networks.processes import usable_processors

DIFFERS = 1
REASONS = 5
"""Most reasons of failures in one line."""


def evaluate_on_parking(
    agent: str,
    benchmark: str,
    settings: Mapping[str, Any],
    seeds: Sequence[int] | None,
    folder: Path,
    workers: int,
    as_json: bool,
    deadline_s: float,
) -> None:
    """Evaluates an agent that parks; prints the result, and writes records, motion and an HTML report."""
    found = load_parking_benchmark(benchmark)
    entry = PARKER if agent == ONNX else resolve(agent)
    with ProgressBar(f"{agent} on {found.name}", hidden=as_json) as tell:
        kind = kind_of(entry, dict(settings))
        order = (found, entry, settings, kind, seeds, folder, workers, tell)
        records = evaluate_parking(*order, act_deadline_s=deadline_s, note=print_error)
    if as_json:
        print_json(_document(found.name, records))
    else:
        _print({records[0].agent.name: records})
        console.print(f"report: {(folder / PAGE).resolve()}")
    end_parking(records)


def report_parking(folders: Sequence[Path], out: Path) -> None:
    """Compares evaluations of parking: a table here, and one self-contained HTML file.

    Raises:
        InvalidInputError: A folder holds no evaluation of parking or comes twice, or they are on different benchmarks.
    """
    found = [_evaluation_in(folder) for folder in folders]
    names = names_in_report([records[0].agent for records, _, _ in found], [[folder] for folder in folders])
    evaluated = [Evaluated(name, *one) for name, one in zip(names, found, strict=True)]
    path = write_parking_page(out, evaluated)
    _print({one.name: one.records for one in evaluated})
    for first, second, comparison in comparisons(evaluated):
        if comparison is None:
            console.print(f"{first} and {second} have no common lot")
            continue
        console.print(
            f"{first} {comparison.verdict} {second}: success differs by {interval(comparison.difference)} points on "
            f"{comparison.difference.n} common lot{'s' * (comparison.difference.n != 1)}"
        )
    for one in evaluated:
        print_part(one.part, f"{one.name}: ")
    if mixed := mixed_versions(evaluated):
        console.print(f"take care: {mixed}", highlight=False)
    console.print(f"report: {path.resolve()}")


def _evaluation_in(folder: Path) -> tuple[Sequence[ParkingRecord], Motions, str]:
    """Records of an evaluation, the motion of the lots that a report shows, and its part of what was ordered."""
    fetched = is_lots_folder(folder)
    records = read_lots(folder) if fetched else read_records(folder / RECORDS)
    motions = (read_lot_motions if fetched else read_motion)(folder, shown_records(records))
    return records, motions, part_of_lots(folder, records) if fetched else ""  # local ones are written once complete


def verify_parking(path: Path, trust: bool, as_json: bool, deadline_s: float) -> None:
    """Drives the lots of records again and compares the hashes. Exit code 1 if one differs.

    Raises:
        InvalidInputError: The records were changed, or their agent cannot be made or is not one they may choose.
    """
    records = read_records(path if path.is_file() else path / RECORDS)
    replayed = drive_lots_again(path, records, trust, deadline_s, hidden=as_json)
    pairs = zip(records, replayed, strict=True)
    differing = [old.seed for old, new in pairs if old.record_hash != new]
    if as_json:
        print_json({"records": str(path), "lots": len(records), "same": not differing, "differing": differing})
    elif differing:
        console.print(f"DIFFERS: {len(differing)} of {len(records)} lots, first lot {differing[0]}")
    else:
        console.print(f"same: all {len(records)} lots")
    if differing:
        raise typer.Exit(DIFFERS)


def drive_lots_again(
    path: Path,
    records: Sequence[ParkingRecord],
    trust: bool,
    deadline_s: float,
    policy: Path | None = None,
    hidden: bool = True,
) -> list[str]:
    """Drives the lots of records again; returns the new hashes, in their order.

    Args:
        path: Place of the records, for messages.
        records: Of one agent on one benchmark.
        trust: Whether to build whatever agent they name.
        deadline_s: Wall-clock time allowed for one decision, s.
        policy: ONNX file of their policy; None: it lies in the folder of uploaded policies.
        hidden: Whether to hide the progress bar.

    Raises:
        InvalidInputError: Their agent cannot be made, or is not one that they may choose.
    """
    check_trusted(records[0].agent, path, trust)
    with ProgressBar(f"lots of {records[0].benchmark.name}", hidden=hidden) as tell:
        more = {} if policy is None else {"path": str(policy)}
        return drive_again(records, usable_processors(), tell, more, deadline_s)


def _document(benchmark: str, records: Sequence[ParkingRecord]) -> dict[str, Any]:
    lots = [record.model_dump(mode="json", exclude={"benchmark", "agent"}) for record in records]
    return {"benchmark": benchmark} | summarise_parking(records).document() | {"lots": lots}


def _print(evaluated: Mapping[str, Sequence[ParkingRecord]]) -> None:
    results = {name: summarise_parking(records) for name, records in evaluated.items()}
    titles = [f"{one.title}, {one.unit}" for one in MEASURES]
    print_rows(
        ["agent", *titles],
        [(name, *(interval(result.estimates[one.key]) for one in MEASURES)) for name, result in results.items()],
    )
    for name, records in evaluated.items():
        failures = Counter(one.failure for record in records for one in record.karts if one.failure)
        if failures:
            console.print(f"{name} failed in {_karts(failures.total())}: {_reasons(failures)}", highlight=False)


def _reasons(failures: Counter[str]) -> str:
    """Reasons with their counts, the most frequent first; the rest counted together."""
    told = [why if len(failures) == 1 else f"{why} ({count})" for why, count in failures.most_common(REASONS)]
    rest = failures.total() - sum(count for _, count in failures.most_common(REASONS))
    return "; ".join(told + [f"others ({rest})"] * (rest > 0))


def _karts(number: int) -> str:
    return f"{number} kart{'s' * (number != 1)}"
