"""The rows of a report: drives with their scores, factor by factor."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from dohyo.evaluation.records.record import EgoRecord, EpisodeRecord
from dohyo.evaluation.report import figures
from dohyo.evaluation.report.contenders import Contender
from dohyo.evaluation.report.style import number
from dohyo.evaluation.scores.driving import (
    Rules,
    driving_score,
    infraction_penalty,
    outside_fraction,
    route_completion,
)


@dataclass(frozen=True, slots=True)
class Term:
    """A part of a score's formula, with its meaning."""

    text: str
    note: str


@dataclass(frozen=True, slots=True)
class Drive:
    """One ego of one episode, a row of the table of drives."""

    anchor: str
    contender: Contender
    record: EpisodeRecord
    ego: EgoRecord
    href: str
    mission: str
    score: float
    why: tuple[Term, ...]


def make_drives(contenders: Sequence[Contender], path: Path, rules: Rules) -> Iterator[Drive]:
    """Every ego of every episode; links to records are relative to `path`, the path of the page."""
    folder = path.parent.resolve()
    for contender in contenders:
        one = contender.evaluation
        for i, (record, file) in enumerate(zip(one.records, one.record_paths, strict=True)):
            href = quote(Path(os.path.relpath(file.resolve(), folder)).as_posix())
            for j, ego in enumerate(record.egos):
                yield Drive(
                    anchor=f"drive-{contender.place}-{i}-{j}",
                    contender=contender,
                    record=record,
                    ego=ego,
                    href=href,
                    mission=figures.mission_name(record, ego),
                    score=driving_score(ego, rules),
                    why=tuple(_why(ego, rules)),
                )


def worst_first(drive: Drive) -> tuple[float, str, int, str]:
    """Sort key of drives: lowest driving score first; ties have the same order in every run."""
    return drive.score, drive.mission, drive.record.scenario.seed, drive.contender.name


def _why(ego: EgoRecord, rules: Rules) -> Iterator[Term]:
    """The driving score, factor by factor, such as 80 x 0.6 x 0.7 = 33.6."""
    yield Term(_factor(route_completion(ego)), "route completed, %")
    if outside := outside_fraction(ego):
        yield Term(f" × {_factor(1 - outside)}", f"{number(ego.outside_lanes_m)} m driven outside lanes")
    factors = [(one, infraction_penalty((one,), rules, 0.0)) for one in ego.infractions]
    notes = [
        (factor, f"{one.kind.specification.label} at {number(one.time_s)} s") for one, factor in factors if factor < 1
    ]
    if rules == "2.1" and notes:
        yield Term(" / (1", "rules 2.1 divide by one plus the costs")
        yield from (Term(f" + {_factor(1 / factor - 1)}", note) for factor, note in notes)
        yield Term(")", "rules 2.1 divide by one plus the costs")
    else:
        yield from (Term(f" × {_factor(factor)}", note) for factor, note in notes)
    if not outside and not notes:
        yield Term(" × 1", "no infraction lowers the score")
    yield Term(f" = {number(driving_score(ego, rules))}", "driving score DS, %")


def _factor(value: float) -> str:
    """A number like `number`, without trailing zeros: 0.6, not 0.600."""
    return f"{value:.3g}"
