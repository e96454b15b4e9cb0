"""The contenders of a report: agents in the order of the benchmark's headline, and pairs of them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.report import style as look
from dohyo.evaluation.scores.driving import IrsLength, Rules
from dohyo.evaluation.scores.nuplan.summary import (
    ClosedLoopSummary,
    ScoredDrive,
    applies,
    compare_closed_loop,
    lost_drives,
    score_records,
    summarise_closed_loop,
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
        headline: Score by which the benchmark ranks agents.
        metric: Computation of the headline score in words.
        part: Part of the benchmark that was driven, such as "part of nocrash: 10 of 150 missions"; "" for all of it.
    """

    agent: str
    benchmark: str
    benchmark_hash: str
    records: tuple[EpisodeRecord, ...]
    record_paths: tuple[Path, ...]
    headline: Headline = Headline.DRIVING_SCORE
    metric: str = ""
    part: str = ""

    def __post_init__(self) -> None:
        if len(self.records) != len(self.record_paths):
            raise InvalidInputError(
                f"expected one path per record of '{self.agent}', got {len(self.records)} records and "
                f"{len(self.record_paths)} paths"
            )


@dataclass(frozen=True, slots=True)
class ClosedLoopResult:
    """Drives with their closed-loop score, and the summary of them."""

    drives: list[ScoredDrive]
    summary: ClosedLoopSummary


@dataclass(frozen=True, slots=True)
class Contender:
    """An agent in the report, with its place, colour and numbers.

    Attributes:
        place: Place by the headline, from 0.
        name: Name of the agent, unique in the report.
        colour: Colour of the agent on the page.
        evaluation: Evaluation of the agent.
        summary: Summary of its records.
        closed_loop: Closed-loop scores; None if the scenarios have no reference.
    """

    place: int
    name: str
    colour: str
    evaluation: Evaluation
    summary: Summary
    closed_loop: ClosedLoopResult | None

    @property
    def scores(self) -> dict[str, Estimate]:
        """Estimate of each score by its name, the closed-loop score among them where there is one."""
        return _scores(self.summary, self.closed_loop)

    @property
    def scores_lost_as_zero(self) -> dict[str, Estimate] | None:
        """The same with every lost drive counting 0; None if no drive was lost."""
        found = self.summary.scores_lost_as_zero
        closed = self.closed_loop and self.closed_loop.summary.score_lost_as_zero
        return found and found | ({Headline.CLOSED_LOOP.value: closed} if closed else {})

    @property
    def headline(self) -> Estimate:
        """Estimate of the benchmark's headline."""
        return self.scores[self.evaluation.headline]


@dataclass(frozen=True, slots=True)
class Pair:
    """Two agents and their comparisons by score; without a common drive, only the reason."""

    a: Contender
    b: Contender
    comparisons: dict[str, Comparison]
    reason: str

    @property
    def headline(self) -> Comparison:
        """Comparison by the benchmark's headline."""
        return self.comparisons[self.a.evaluation.headline]


def make_contenders(evaluations: Sequence[Evaluation], rules: Rules, irs_length: IrsLength) -> list[Contender]:
    """Contenders in the order of the evaluations.

    Their places are by the benchmark's headline, best first; after them, likewise, agents that drove only a part of the
    benchmark.

    Raises:
        InvalidInputError: If there is no evaluation, an agent comes twice, the benchmarks differ, or records cannot be
            summarised together.
    """
    _check(evaluations)
    colours = look.agent_colours(one.agent for one in evaluations)
    found = [
        (one, summarise(one.records, rules=rules, irs_length=irs_length), _closed_loop(one)) for one in evaluations
    ]

    def rank(i: int) -> tuple[bool, float, str]:
        one, summary, closed_loop = found[i]
        mean = _scores(summary, closed_loop)[one.headline].mean
        return bool(one.part), math.inf if mean is None else -mean, one.agent

    places = {i: place for place, i in enumerate(sorted(range(len(found)), key=rank))}
    return [
        Contender(places[i], one.agent, colours[one.agent], one, summary, closed_loop)
        for i, (one, summary, closed_loop) in enumerate(found)
    ]


def _check(evaluations: Sequence[Evaluation]) -> None:
    if not evaluations:
        raise InvalidInputError("expected at least one evaluation to report, got none")
    names = Counter(one.agent for one in evaluations)
    if twice := [name for name, count in names.items() if count > 1]:
        raise InvalidInputError(f"expected one evaluation per agent, got several of {', '.join(sorted(twice))}")
    versions = {(one.benchmark, one.benchmark_hash) for one in evaluations}
    if len(versions) > 1:
        given = ", ".join(f"{name} ({digest[:12]})" for name, digest in sorted(versions))
        raise InvalidInputError(f"expected evaluations of one benchmark version, got {given}")


def _scores(summary: Summary, closed_loop: ClosedLoopResult | None) -> dict[str, Estimate]:
    return summary.scores | ({Headline.CLOSED_LOOP.value: closed_loop.summary.score} if closed_loop else {})


def _closed_loop(evaluation: Evaluation) -> ClosedLoopResult | None:
    records = evaluation.records
    if evaluation.headline is not Headline.CLOSED_LOOP and not all(map(applies, records)):
        return None
    drives = score_records(zip(records, evaluation.record_paths, strict=True))
    return ClosedLoopResult(drives, summarise_closed_loop(drives, lost_drives(records)))


def make_pairs(contenders: Sequence[Contender]) -> list[Pair]:
    """All pairs of agents, the one with the better place first."""
    return [_pair(a, b) for a, b in combinations(sorted(contenders, key=lambda one: one.place), 2)]


def _pair(a: Contender, b: Contender) -> Pair:
    """Compares two agents on their common drives, or gives the reason if they have none."""
    rules, irs_length = a.summary.rules, a.summary.irs_length
    try:
        comparisons = compare(a.evaluation.records, b.evaluation.records, rules=rules, irs_length=irs_length)
    except InvalidInputError as error:
        return Pair(a, b, {}, str(error))
    if a.closed_loop and b.closed_loop:
        comparisons[Headline.CLOSED_LOOP.value] = compare_closed_loop(a.closed_loop.drives, b.closed_loop.drives)
    return Pair(a, b, comparisons, "")
