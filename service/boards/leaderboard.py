"""Leaderboard: the places of a ranking by the headline score, ties shown as ties."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from functools import cached_property
from typing import Any, Final

import numpy as np

from dohyo.evaluation.families import Family
from dohyo.evaluation.report.spreadsheet import csv_text
from dohyo.evaluation.statistics import Estimate, significantly_below
from dohyo.service.evaluations.scoring import (
    CLOSED_LOOP_SCORES,
    FORECAST_SCORES,
    MORNING_SCORES,
    PARKING_SCORES,
    Drive,
    estimate,
    rates_per_km,
    scores_of,
)
from dohyo.service.evaluations.versions import EARLIER, newest, version_order
from dohyo.sumo_networks.arrays import BoolArray, FloatArray

COLUMNS = ("driving_score", "route_completion", "infraction_penalty", "irs", "success", "nocrash_success")
OF_SOME = ("drove_2500m", *CLOSED_LOOP_SCORES, *MORNING_SCORES, *PARKING_SCORES, *FORECAST_SCORES)
"""Columns of benchmarks that rank by nuPlan's score or one of its terms, of mornings, parking lots and forecasts."""
LOST_SHARE: Final = 0.1
"""Largest share of its drives that a run with a rank has lost: else the mean of a few drives would beat all others."""


class Unranked(StrEnum):
    """Why a place has no rank.

    OTHER_VERSION: another version of dohyo drove it than the runs with a rank, or several versions did. LOST_TOO_MANY:
    it lost more than `LOST_SHARE` of its drives. LOW_THROUGHPUT: fewer vehicles passed than its benchmark asks for.
    BASELINE: it is the organiser's, to compare with.
    """

    OTHER_VERSION = "other_version"
    LOST_TOO_MANY = "lost_too_many"
    LOW_THROUGHPUT = "low_throughput"
    BASELINE = "baseline"


@dataclass(frozen=True, slots=True)
class Driver:
    """A submission that drives.

    Attributes:
        submission: Identifier.
        agent: Name of the agent.
        version: Version of the agent.
        owner: Owner of the agent.
        kind: Kind of the submission: builtin, onnx, remote.
        track: Which sensors it may use.
    """

    submission: str
    agent: str
    version: int
    owner: str
    kind: str
    track: str

    @property
    def name(self) -> str:
        """Name and version of the agent, for people."""
        return f"{self.agent} v{self.version}"


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
        lost_egos: The same, by ego.
        gridlocked: Those of them that have a record, which is kept.
        others: Drivers of single egos of a mixed run, by ego.
        dohyo_versions: Versions of dohyo that drove it.
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
    lost_egos: Mapping[str, int] = field(default_factory=dict)
    gridlocked: tuple[Drive, ...] = ()
    others: Mapping[str, Driver] = field(default_factory=dict)
    dohyo_versions: tuple[str, ...] = ()

    @property
    def driver(self) -> Driver:
        """The driver of all egos but `others`."""
        return Driver(self.submission, self.agent, self.version, self.owner, self.kind, self.track)

    def driver_of(self, ego: str) -> Driver:
        """The driver of an ego."""
        return self.others.get(ego, self.driver)

    def lost_of(self, driver: Driver) -> int:
        """Number of a driver's lost drives."""
        return sum(count for ego, count in self.lost_egos.items() if self.driver_of(ego) == driver)

    @cached_property
    def scores(self) -> dict[str, Estimate]:
        """Every column with its interval; computed once, since a finished evaluation never changes."""
        there = scores_of(self.drives)
        return {name: estimate(name, self.drives) for name in (*COLUMNS, *OF_SOME) if name in there}

    @property
    def low_throughput(self) -> bool:
        """Whether fewer vehicles passed than the benchmark of mornings asks for, in the mean of all of them."""
        passed = self.scores["throughput_vph"].mean if "throughput_vph" in self.scores else None
        return passed is not None and any(passed < one.facts.get("least_throughput_vph", 0.0) for one in self.drives)

    @cached_property
    def per_km(self) -> dict[str, float]:
        """Infractions per kilometre."""
        return rates_per_km(self.drives)


@dataclass(frozen=True, slots=True, eq=False)
class Contender:
    """A complete run that may be its entrant's place, with as little as ranking needs.

    Attributes:
        evaluation: Identifier of the run.
        entrant: Identifier of the place: a team, in an open ranking an agent, or the submission of a baseline.
        baseline: Whether it stands on the board without a rank.
        track: Which sensors its agent may use.
        score: Mean of the headline score.
        number: Of its order: smaller ones came first.
        dohyo_versions: Versions of dohyo that drove it.
        values: (episodes,) mean headline score of the egos of each, in the same order for every run of the ranking; NaN
            for a lost one.
        low_throughput: Whether fewer vehicles passed than its benchmark asks for.
        comparisons: Its paired comparisons with other runs of the ranking, by evaluation, see `compare_places`.
    """

    evaluation: str
    entrant: str
    baseline: bool
    track: str
    score: float
    number: int
    dohyo_versions: tuple[str, ...]
    values: FloatArray
    low_throughput: bool = False
    comparisons: dict[str, dict[str, Any] | None] = field(default_factory=dict, init=False, repr=False)

    @property
    def lost(self) -> int:
        """Number of lost episodes."""
        return int(np.isnan(self.values).sum())

    @property
    def lost_too_many(self) -> bool:
        """Whether the run lost more than `LOST_SHARE` of its episodes."""
        return self.lost > LOST_SHARE * len(self.values)

    @property
    def version(self) -> str | None:
        """The version of dohyo that drove all of it; None: there are several."""
        return self.dohyo_versions[0] if len(self.dohyo_versions) == 1 else None

    def unranked(self, version: str | None) -> Unranked | None:
        """Why it has no rank on a board of this version of dohyo; None: it has one."""
        if self.version is None or self.version != version:
            return Unranked.OTHER_VERSION
        if self.lost_too_many:
            return Unranked.LOST_TOO_MANY
        if self.low_throughput:
            return Unranked.LOW_THROUGHPUT
        return Unranked.BASELINE if self.baseline else None

    def common(self, other: Contender) -> BoolArray:
        """(episodes,) which of two runs both count; none where the runs, or what drove them, are not the same."""
        same_judge = self.version is not None and self.version == other.version
        if not same_judge or self.values.shape != other.values.shape:
            return np.zeros(0, dtype=np.bool_)
        both: BoolArray = np.isfinite(self.values) & np.isfinite(other.values)
        return both


@dataclass(frozen=True, slots=True)
class Place:
    """A place on the leaderboard.

    Attributes:
        rank: Shared by all that do not differ significantly from the best of the rank; None: see `unranked`.
        unranked: Why it has no rank; None where it has one.
        contender: The run.
    """

    rank: int | None
    unranked: Unranked | None
    contender: Contender


def ranked_version(runs: Sequence[Contender]) -> str | None:
    """The newest version of dohyo among the runs that may have a rank, else among all; None: each has several."""
    pure = [run for run in runs if run.version is not None]
    able = [run for run in pure if not (run.baseline or run.lost_too_many or run.low_throughput)]
    return newest([run.dohyo_versions[0] for run in able or pure])


def places_of(runs: Iterable[Contender]) -> list[Contender]:
    """The best run of each entrant, the highest score first; of equal scores, the earlier order.

    Runs with too low a throughput are below all others, and below them those that lost too many drives, those with the
    fewest lost drives first; runs of other versions of dohyo are below those, the newest first.
    """
    best: dict[str, Contender] = {}
    runs = sorted(runs, key=_by_score)
    version = ranked_version(runs)
    for run in sorted(runs, key=lambda run: _newness(run, version), reverse=True):
        best.setdefault(run.entrant, run)
    return list(best.values())


@dataclass(slots=True)
class Ranks:
    """Ranks contenders; keeps the verdicts, since complete runs never change and few are new.

    An entrant shares the rank above it unless the paired comparison with the best of that rank is significantly lower.
    """

    _lower: dict[tuple[str, str], bool] = field(default_factory=dict)

    def rank(self, contenders: Sequence[Contender]) -> list[Place]:
        """Places in the order of the contenders, which is that of `places_of`."""
        if len(self._lower) > _MOST_VERDICTS * (len(contenders) + 1):
            self._lower.clear()
        version = ranked_version(contenders)
        why = {one.evaluation: one.unranked(version) for one in contenders}
        ranked = [one for one in contenders if why[one.evaluation] is None]
        ranks: dict[str, int] = {}
        start = 0
        while start < len(ranked):
            end = self._end_of_tie(ranked, start)
            ranks |= {one.evaluation: start + 1 for one in ranked[start:end]}
            start = end
        return [Place(ranks.get(one.evaluation), why[one.evaluation], one) for one in contenders]

    def _end_of_tie(self, ranked: Sequence[Contender], start: int) -> int:
        """Index of the first contender after `start` that is significantly lower than it."""
        best, at, size = ranked[start], start + 1, _FIRST_BLOCK
        while at < len(ranked):
            for k, lower in enumerate(self._compared(best, ranked[at : at + size])):
                if lower:
                    return at + k
            at, size = at + size, min(2 * size, _LARGEST_BLOCK)
        return len(ranked)

    def _compared(self, best: Contender, block: Sequence[Contender]) -> list[bool]:
        new = [one for one in block if (best.evaluation, one.evaluation) not in self._lower]
        # Without a drive in common, means alone decide.
        self._lower |= {(best.evaluation, one.evaluation): one.score < best.score for one in new}
        for common, some in _by_common(best, new):
            verdicts = significantly_below(best.values[common], np.stack([one.values[common] for one in some]))
            for one, lower in zip(some, verdicts, strict=True):
                self._lower[best.evaluation, one.evaluation] = bool(lower)
        return [self._lower[best.evaluation, one.evaluation] for one in block]


def _by_common(best: Contender, others: Iterable[Contender]) -> Iterator[tuple[BoolArray, list[Contender]]]:
    """Contenders by the drives that count in them and in the best one; those without any are left out."""
    found: dict[bytes, tuple[BoolArray, list[Contender]]] = {}
    for one in others:
        common = best.common(one)
        if common.any():
            found.setdefault(common.tobytes(), (common, []))[1].append(one)
    yield from found.values()


_MOST_VERDICTS: Final = 20  # per contender
_FIRST_BLOCK: Final = 8
_LARGEST_BLOCK: Final = 512


def columns_of(metric: str, family: Family) -> tuple[str, ...]:
    """The scores that a leaderboard shows."""
    if family is Family.PARKING:
        return PARKING_SCORES
    if family is Family.FORECASTING:
        return FORECAST_SCORES
    if metric in MORNING_SCORES:
        return MORNING_SCORES
    if metric in CLOSED_LOOP_SCORES:
        return (*CLOSED_LOOP_SCORES, *COLUMNS)
    return COLUMNS if metric in COLUMNS else (metric, *COLUMNS)


def as_csv(rows: Sequence[Mapping[str, Any]], metric: str, family: Family) -> str:
    """The leaderboard as CSV: a line per row of its document, each score with the ends of its interval."""
    columns = columns_of(metric, family)
    header = ["rank", "team", "agent", "version", "owner", "kind", "verified", "baseline", "track", "evaluation"]
    header += ["runs", "thrown_away", "seeds", "drives", "lost", "lost_too_many", "unranked"]
    lines: list[list[object]] = []
    for row in rows:
        ends = [row["scores"].get(name, {}).get(end) for name in columns for end in ("mean", "low", "high")]
        above = [row["above"]["verdict"], row["above"]["probability"]] if row["above"] else [None, None]
        dohyo = " ".join(row["dohyo_versions"])
        lines.append([*(row[name] for name in header), dohyo, metric, *ends, *above])
    names = [f"{name}{end}" for name in columns for end in ("", "_low", "_high")]
    return csv_text([*header, "dohyo_versions", "metric", *names, "verdict_above", "probability_above"], lines)


def _newness(run: Contender, version: str | None) -> tuple[bool, bool, object]:
    """Sorts runs of the ranked version above those of others, of which the newest come first, and above mixed ones."""
    return run.version == version, run.version is not None, version_order(run.version or EARLIER)


def _by_score(run: Contender) -> tuple[int, bool, float, int, str]:
    return run.lost if run.lost_too_many else 0, run.low_throughput, -run.score, run.number, run.evaluation
