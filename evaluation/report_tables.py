"""The tables of a report as CSV, for spreadsheets."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Callable, Iterable, Sequence

from evaluation.report_rows import Contender, Drive, Pair
from evaluation.scores.driving import route_completion
from evaluation.statistics import Estimate
from evaluation.summary import Summary


def csv_tables(contenders: Sequence[Contender], pairs: Sequence[Pair], drives: Sequence[Drive]) -> dict[str, str]:
    """Every table of the page as CSV."""
    return {
        "scores": _estimate_table(contenders, lambda summary: summary.scores),
        "rates": _estimate_table(contenders, lambda summary: summary.per_km),
        "pairs": _pair_table(pairs),
        "drives": _drive_table(drives),
    }


def _csv(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([_csv_cell(value) for value in row] for row in rows)
    return buffer.getvalue()


def _csv_cell(value: object) -> object:
    """Text that a spreadsheet would take for a formula is quoted; None is empty."""
    formula = isinstance(value, str) and len(value) > 1 and value[0] in "=+-@"
    return f"'{value}" if formula else value


def _estimate_table(contenders: Iterable[Contender], estimates: Callable[[Summary], dict[str, Estimate]]) -> str:
    rows = (
        (one.name, name, *dataclasses.astuple(estimate))
        for one in contenders
        for name, estimate in estimates(one.summary).items()
    )
    return _csv(("agent", "quantity", "mean", "low", "high", "n"), rows)


def _pair_table(pairs: Iterable[Pair]) -> str:
    rows = (
        (pair.a.name, pair.b.name, name, one.verdict, one.probability, *dataclasses.astuple(one.difference))
        for pair in pairs
        for name, one in pair.comparisons.items()
    )
    header = ("a", "b", "quantity", "verdict", "probability", "difference mean", "low", "high", "n")
    return _csv(header, rows)


def _drive_table(drives: Iterable[Drive]) -> str:
    rows = (
        (
            drive.contender.name,
            drive.mission,
            drive.record.scenario.seed,
            drive.ego.status.value,
            drive.ego.failure,
            drive.score,
            route_completion(drive.ego),
            len(drive.ego.infractions),
            drive.record.record_hash,
        )
        for drive in drives
    )
    header = ("agent", "mission", "seed", "status", "failure", "DS", "RC", "infractions", "record_hash")
    return _csv(header, rows)
