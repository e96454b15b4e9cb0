"""The tables of a report as CSV, for spreadsheets."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence

from dohyo.evaluation.report.contenders import Contender, Pair
from dohyo.evaluation.report.rows import Drive
from dohyo.evaluation.report.spreadsheet import csv_text
from dohyo.evaluation.scores.driving import route_completion
from dohyo.evaluation.statistics import Estimate


def csv_tables(contenders: Sequence[Contender], pairs: Sequence[Pair], drives: Sequence[Drive]) -> dict[str, str]:
    """Every table of the page as CSV."""
    return {
        "scores": _estimate_table(contenders, _scores),
        "rates": _estimate_table(contenders, lambda one: one.summary.per_km),
        "pairs": _pair_table(pairs),
        "drives": _drive_table(drives),
    }


def _estimate_table(contenders: Iterable[Contender], estimates: Callable[[Contender], dict[str, Estimate]]) -> str:
    rows = (
        (one.name, name, *dataclasses.astuple(estimate), one.evaluation.part)
        for one in contenders
        for name, estimate in estimates(one).items()
    )
    return csv_text(("agent", "quantity", "mean", "low", "high", "n", "part"), rows)


def _scores(contender: Contender) -> dict[str, Estimate]:
    as_zero = contender.scores_lost_as_zero or {}
    return contender.scores | {f"{name}_lost_as_zero": estimate for name, estimate in as_zero.items()}


def _pair_table(pairs: Iterable[Pair]) -> str:
    rows = (
        (pair.a.name, pair.b.name, name, one.verdict, one.probability, *dataclasses.astuple(one.difference))
        for pair in pairs
        for name, one in pair.comparisons.items()
    )
    header = ("a", "b", "quantity", "verdict", "probability", "difference mean", "low", "high", "n")
    return csv_text(header, rows)


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
    return csv_text(header, rows)
