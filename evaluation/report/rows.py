"""The rows of a report: agents, drives with their scores factor by factor, and pairs of agents."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from dohyo.evaluation.records.record import EgoRecord, EpisodeRecord
from dohyo.evaluation.report import figures
from dohyo.evaluation.report import style as look
from dohyo.evaluation.report.style import number
from dohyo.evaluation.scores.driving import (
    IrsLength,
    Rules,
    driving_score,
    infraction_penalty,
    outside_fraction,
    route_completion,
)
from dohyo.evaluation.statistics import Comparison, Estimate
from dohyo.evaluation.summary import Summary, compare, summarise
from dohyo.sumo_networks.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The evaluation of one agent on one benchmark.

    Attributes:
        agent: Name of the agent, unique in the report.
        benchmark: Name of the benchmark.
        benchmark_hash: Content hash of the benchmark.
        records: Records of all episodes, lost ones included.
        record_paths: Paths of the records' JSON files, in the same order.
        metric: Computation of the headline score in words.
        part: Part of the benchmark that was driven, such as "part of nocrash: 10 of 150 missions"; "" for all of it.
    """

    agent: str
    benchmark: str
    benchmark_hash: str
    records: tuple[EpisodeRecord, ...]
    record_paths: tuple[Path, ...]
    metric: str = ""
    part: str = ""

    def __post_init__(self) -> None:
        if len(self.records) != len(self.record_paths):
            raise InvalidInputError(
                f"expected one path per record of '{self.agent}', got {len(self.records)} records and "
                f"{len(self.record_paths)} paths"
            )


@dataclass(frozen=True, slots=True)
class Contender:
    """An agent in the report, with its place, colour and numbers."""

    place: int
    name: str
    colour: str
    evaluation: Evaluation
    summary: Summary


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


@dataclass(frozen=True, slots=True)
class Pair:
    """Two agents and their comparisons; without a common drive, only the reason."""

    a: Contender
    b: Contender
    comparisons: dict[str, Comparison]
    reason: str


def make_contenders(evaluations: Sequence[Evaluation], rules: Rules, irs_length: IrsLength) -> list[Contender]:
    """Agents by driving score, best first; after them, likewise, those that drove only a part of the benchmark."""
    colours = look.agent_colours(one.agent for one in evaluations)
    found = [(one, summarise(one.records, rules=rules, irs_length=irs_length)) for one in evaluations]
    found.sort(key=lambda pair: (bool(pair[0].part), -_mean(pair[1].scores["driving_score"]), pair[0].agent))
    return [Contender(place, one.agent, colours[one.agent], one, summary) for place, (one, summary) in enumerate(found)]


def _mean(estimate: Estimate) -> float:
    return -math.inf if estimate.mean is None else estimate.mean


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


def make_pair(a: Contender, b: Contender, rules: Rules, irs_length: IrsLength) -> Pair:
    """Compares two agents on their common drives, or gives the reason if they have none."""
    try:
        comparisons = compare(a.evaluation.records, b.evaluation.records, rules=rules, irs_length=irs_length)
    except InvalidInputError as error:
        return Pair(a, b, {}, str(error))
    return Pair(a, b, comparisons, "")
