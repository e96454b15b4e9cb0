"""Leaderboard: submissions on one benchmark version and track, by its headline score, ties shown as ties."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from functools import cached_property
from typing import Any

from dohyo.evaluation.report.spreadsheet import csv_text
from dohyo.evaluation.statistics import Comparison, Estimate
from dohyo.service.evaluations.scoring import (
    CLOSED_LOOP_SCORES,
    Drive,
    compare_drives,
    estimate,
    rates_per_km,
    scores_of,
)

COLUMNS = ("driving_score", "route_completion", "infraction_penalty", "irs", "success", "nocrash_success")
OF_SOME = ("drove_2500m", *CLOSED_LOOP_SCORES)
"""Columns of benchmarks that rank by nuPlan's score or one of its terms."""


@dataclass(frozen=True)
class Entry:
    """A finished evaluation with the facts that leaderboards and comparisons need.

    Attributes:
        evaluation: Identifier.
        submission: Identifier of the submission.
        agent: Name of the agent.
        version: Version of the agent.
        owner: Owner of the submission.
        kind: Kind of the submission: builtin, onnx, remote.
        track: Which sensors it may use.
        benchmark: Name of the benchmark.
        benchmark_sha256: Version of the benchmark.
        seeds: Driven seeds.
        finished: Time of its end.
        drives: All drives that count.
        lost: Number of drives lost to gridlocks and infrastructure faults, by cell.
    """

    evaluation: str
    submission: str
    agent: str
    version: int
    owner: str
    kind: str
    track: str
    benchmark: str
    benchmark_sha256: str
    seeds: tuple[int, ...]
    finished: datetime | None
    drives: tuple[Drive, ...]
    lost: Mapping[str, int] = field(default_factory=dict)

    @cached_property
    def scores(self) -> dict[str, Estimate]:
        """Every column with its interval; computed once, since a finished evaluation never changes."""
        there = scores_of(self.drives)
        return {name: estimate(name, self.drives) for name in (*COLUMNS, *OF_SOME) if name in there}

    @cached_property
    def per_km(self) -> dict[str, float]:
        """Infractions per kilometre."""
        return rates_per_km(self.drives)


@dataclass(frozen=True, slots=True)
class Row:
    """A place on the leaderboard.

    Attributes:
        rank: Shared by all entries that do not differ significantly from the best of the rank.
        entry: Ranked evaluation.
        above: Comparison with the row above: "<" significantly lower, "=" not; None for the first row.
    """

    rank: int
    entry: Entry
    above: Comparison | None


def rank(entries: Sequence[Entry], metric: str) -> list[Row]:
    """Entries by the mean of a score, highest first; equal means in the order of agent, version and evaluation.

    An entry shares the rank above it unless the paired comparison with the best entry of that rank is significantly
    lower. Without drives in common, means alone decide.

    Args:
        entries: Evaluations of one benchmark version, with at least one drive each.
        metric: Name of a score that all of them have.
    """
    rows: list[Row] = []
    for entry in sorted(entries, key=lambda one: _place(one, metric)):
        if not rows:
            rows.append(Row(1, entry, None))
            continue
        last = rows[-1]
        best = rows[last.rank - 1].entry
        above = compare_drives(metric, entry.drives, last.entry.drives)
        from_best = above if best is last.entry else compare_drives(metric, entry.drives, best.drives)
        tied = _same_mean(entry, best, metric) if from_best is None else from_best.verdict != "<"
        rows.append(Row(last.rank if tied else len(rows) + 1, entry, above))
    return rows


def columns_of(metric: str) -> tuple[str, ...]:
    """The scores that a leaderboard shows."""
    if metric in CLOSED_LOOP_SCORES:
        return (*CLOSED_LOOP_SCORES, *COLUMNS)
    return COLUMNS if metric in COLUMNS else (metric, *COLUMNS)


def as_document(row: Row, metric: str) -> dict[str, Any]:
    """A row as plain JSON."""
    entry = row.entry
    return {
        "rank": row.rank,
        "agent": entry.agent,
        "version": entry.version,
        "submission": entry.submission,
        "evaluation": entry.evaluation,
        "owner": entry.owner,
        "kind": entry.kind,
        "track": entry.track,
        "seeds": len(entry.seeds),
        "episodes": len({drive.episode for drive in entry.drives}),
        "drives": len(entry.drives),
        "finished": entry.finished.isoformat() if entry.finished else None,
        "scores": {name: asdict(entry.scores[name]) for name in columns_of(metric)},
        "per_km": entry.per_km,
        "above": asdict(row.above) if row.above else None,
    }


def as_csv(rows: Sequence[Row], metric: str) -> str:
    """The leaderboard as CSV: a row per submission, each score with the ends of its interval."""
    columns = columns_of(metric)
    header = ["rank", "agent", "version", "owner", "kind", "track", "evaluation", "seeds", "drives", "metric"]
    header += [f"{name}{end}" for name in columns for end in ("", "_low", "_high")]
    header += ["verdict_above", "probability_above"]
    lines: list[list[object]] = []
    for row in rows:
        one = row.entry
        who = [row.rank, one.agent, one.version, one.owner, one.kind, one.track, one.evaluation]
        ends = [end for name in columns for end in _ends(one.scores[name])]
        above = [row.above.verdict, row.above.probability] if row.above else [None, None]
        lines.append([*who, len(one.seeds), len(one.drives), metric, *ends, *above])
    return csv_text(header, lines)


def _place(entry: Entry, metric: str) -> tuple[float, str, int, str]:
    return -(entry.scores[metric].mean or 0.0), entry.agent, entry.version, entry.evaluation


def _same_mean(a: Entry, b: Entry, metric: str) -> bool:
    return a.scores[metric].mean == b.scores[metric].mean


def _ends(score: Estimate) -> tuple[float | None, float | None, float | None]:
    return score.mean, score.low, score.high
