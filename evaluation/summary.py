"""Summary: the scores of an agent's records on a benchmark, and the comparison of two agents."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from statistics import fmean
from types import MappingProxyType
from typing import Any

from dohyo.evaluation.records.record import AgentInfo, EgoRecord, EpisodeRecord
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.scores import nocrash
from dohyo.evaluation.scores.driving import (
    MIN_KM,
    IrsLength,
    Rules,
    driving_score,
    infraction_penalty,
    infraction_rate_score,
    kept_to_the_lanes,
    outside_fraction,
    route_completion,
    route_km,
)
from dohyo.evaluation.statistics import (
    Comparison,
    Estimate,
    grouped_estimate,
    mean_estimate,
    paired,
    percent_estimate,
    ratio_estimate,
)
from dohyo.sumo_networks.errors import InvalidInputError

SCORES = (
    "success",
    "nocrash_success",
    "road_completed",
    "drove_2500m",
    "route_completion",
    "infraction_penalty",
    "driving_score",
    "irs",
)
SHARES = ("success", "nocrash_success", "drove_2500m")
"""Scores that are 0 or 100 in every drive."""


@dataclass(frozen=True, slots=True)
class Summary:
    """One agent on one benchmark; every mean is over drives (one ego of one episode).

    The egos of one episode meet each other, so that intervals are over episodes.

    Attributes:
        agent: Name of the agent.
        benchmark: Name of the benchmark, or None.
        benchmark_hash: Content hash of the benchmark, or None.
        rules: Version of the leaderboard's rules behind the penalty and the driving score.
        irs_length: Length by which the infraction rate score divides.
        episodes: Number of episodes in the means.
        lost: Number of drives lost to gridlocks and infrastructure faults, all of a lost episode.
        scores: Estimate of each score of `SCORES`, by its name: percent, except infraction_penalty in [0, 1]. Lost
            drives are left out.
        scores_lost_as_zero: Estimates with every lost drive counting 0, as CARLA divides by all planned routes; None if
            no drive was lost.
        per_km: Infractions per km of route completed, pooled over drives, for every kind of infraction.
        statuses: Number of drives by status, lost episodes left out.
        km: Length of route completed in all drives, km.
    """

    agent: str
    benchmark: str | None
    benchmark_hash: str | None
    rules: Rules
    irs_length: IrsLength
    episodes: int
    lost: int
    scores: dict[str, Estimate]
    scores_lost_as_zero: dict[str, Estimate] | None
    per_km: dict[str, Estimate]
    statuses: dict[str, int]
    km: float


def summarise(
    records: Iterable[EpisodeRecord],
    *,
    rules: Rules = "2.0",
    irs_length: IrsLength = "completed",
    unrecorded: int = 0,
) -> Summary:
    """Scores every drive of every record; returns the means with their intervals.

    A lost episode is lost for all of its egos, also for egos that had finished. The result does not depend on the order
    of the records.

    Args:
        records: Of one agent on one benchmark.
        rules: Version of the leaderboard's rules.
        irs_length: Length by which the infraction rate score divides.
        unrecorded: Number of drives that were lost without a record; each counts as an episode of its own.

    Raises:
        InvalidInputError: If there is no record, they mix agents or benchmarks, or one scenario comes twice.
    """
    records = list(records)
    return _summary(records, records, rules, irs_length, unrecorded)


def _summary(
    records: Sequence[EpisodeRecord],
    of: Sequence[EpisodeRecord],
    rules: Rules,
    irs_length: IrsLength,
    unrecorded: int,
) -> Summary:
    """See `summarise`; the agent and the benchmark are those of `of`, so that there may be no record."""
    agent, benchmark = _only_agent(of), _only_benchmark(of)
    counted = [record for record in records if not record.lost]
    _reject_repeats(counted)
    drives = [ego for record in counted for ego in record.egos]
    scored = [[score_drive(ego, rules=rules, irs_length=irs_length) for ego in record.egos] for record in counted]
    statuses = Counter(ego.status for ego in drives)
    lost = [len(record.egos) for record in records if record.lost] + [1] * unrecorded
    return Summary(
        agent=agent.name,
        benchmark=benchmark[0] if benchmark else None,
        benchmark_hash=benchmark[1] if benchmark else None,
        rules=rules,
        irs_length=irs_length,
        episodes=len(counted),
        lost=sum(lost),
        scores=_scores(scored, lost=()),
        scores_lost_as_zero=_scores(scored, lost) if lost else None,
        per_km=_per_km(counted),
        statuses={status.value: statuses[status] for status in Status if statuses[status]},
        km=math.fsum(map(route_km, drives)),
    )


def summarise_cells(
    records: Iterable[EpisodeRecord],
    *,
    rules: Rules = "2.0",
    irs_length: IrsLength = "completed",
    unrecorded: Mapping[str, int] = MappingProxyType({}),
) -> dict[str, Summary]:
    """One summary per cell of the benchmark, in the order of their first records; see `summarise`.

    A cell whose drives were all lost without a record has one, too, if there is any record: it comes last.
    """
    records = list(records)
    cells: dict[str, list[EpisodeRecord]] = {}
    for record in records:
        cells.setdefault(record.scenario.cell, []).append(record)
    cells |= {cell: [] for cell, count in unrecorded.items() if records and count and cell not in cells}
    return {
        cell: _summary(some, some or records, rules, irs_length, unrecorded.get(cell, 0))
        for cell, some in cells.items()
    }


def compare(
    records_a: Iterable[EpisodeRecord],
    records_b: Iterable[EpisodeRecord],
    *,
    rules: Rules = "2.0",
    irs_length: IrsLength = "completed",
) -> dict[str, Comparison]:
    """Compares two agents on the drives of both: same scenario name, seed and ego name.

    Drives of only one agent and lost episodes are left out. The egos of one episode are one pair, by their means, since
    they meet each other; `difference.n` of each comparison is the number of pairs.

    Returns:
        Comparison (a - b) for every name in `SCORES`.

    Raises:
        InvalidInputError: If no drive matches, one comes twice on a side, or matched scenarios differ in content.
    """
    side_a, side_b = _by_drive(records_a), _by_drive(records_b)
    keys = sorted(side_a.keys() & side_b.keys())
    if not keys:
        raise InvalidInputError(
            f"no drive in common: {len(side_a)} on one side, {len(side_b)} on the other, none with the same scenario "
            "name, seed and ego name"
        )
    for key in keys:
        if side_a[key][0] != side_b[key][0]:
            raise InvalidInputError(f"scenario '{key[0]}' with seed {key[1]} is not the same on both sides")
    episodes = [[*some] for _, some in groupby(keys, lambda key: key[:2])]
    scored_a, scored_b = (
        [[score_drive(side[key][1], rules=rules, irs_length=irs_length) for key in some] for some in episodes]
        for side in (side_a, side_b)
    )
    return {name: paired(_means(scored_a, name), _means(scored_b, name)) for name in SCORES}


def _means(episodes: Iterable[Sequence[dict[str, float]]], name: str) -> list[float]:
    """Mean of a score over the egos of each episode."""
    return [fmean(ego[name] for ego in egos) for egos in episodes]


def common_drives(records_a: Iterable[EpisodeRecord], records_b: Iterable[EpisodeRecord]) -> int:
    """Number of drives that `compare` would compare."""
    return len(_by_drive(records_a).keys() & _by_drive(records_b).keys())


def score_drive(ego: EgoRecord, *, rules: Rules = "2.0", irs_length: IrsLength = "completed") -> dict[str, float]:
    """Every score of one drive, by its name in `SCORES`."""
    return {
        "success": 100.0 * (ego.status.completed and kept_to_the_lanes(ego)),
        "nocrash_success": 100.0 * nocrash.success(ego),
        "road_completed": nocrash.road_completed(ego),
        "drove_2500m": 100.0 * nocrash.drove(ego),
        "route_completion": route_completion(ego),
        "infraction_penalty": infraction_penalty(ego.infractions, rules, outside_fraction(ego)),
        "driving_score": driving_score(ego, rules),
        "irs": infraction_rate_score(ego, length=irs_length),
    }


def as_document(summary: Summary) -> dict[str, Any]:
    """The summary as plain JSON: dicts, strings, numbers and None."""
    return dataclasses.asdict(summary)


def _scores(scored: Sequence[Sequence[dict[str, float]]], lost: Sequence[int]) -> dict[str, Estimate]:
    """Estimate of every score over the scored drives of each episode, and over those of each lost one, which are 0."""
    zeros = [[0.0] * drives for drives in lost]
    return {name: _estimate(name, [*([drive[name] for drive in some] for some in scored), *zeros]) for name in SCORES}


def _estimate(name: str, episodes: Sequence[Sequence[float]]) -> Estimate:
    return grouped_estimate(episodes, percent_estimate if name in SHARES else mean_estimate)


def _per_km(records: Sequence[EpisodeRecord]) -> dict[str, Estimate]:
    """Infractions per km, resampled by episodes; `n` counts drives."""
    km = [math.fsum(map(route_km, record.egos)) for record in records]
    counts = [Counter(one.kind for ego in record.egos for one in ego.infractions) for record in records]
    drives = sum(len(record.egos) for record in records)
    return {
        kind.value: dataclasses.replace(ratio_estimate([one[kind] for one in counts], km, floor=MIN_KM), n=drives)
        for kind in InfractionKind
    }


def _by_drive(records: Iterable[EpisodeRecord]) -> dict[tuple[str, int, str], tuple[str, EgoRecord]]:
    """Scenario hash and drive by scenario name, seed and ego name; lost episodes left out."""
    drives: dict[tuple[str, int, str], tuple[str, EgoRecord]] = {}
    for record in records:
        if record.lost:
            continue
        scenario = record.scenario
        digest = scenario.content_hash()
        for ego in record.egos:
            key = (scenario.name, scenario.seed, ego.name)
            if key in drives:
                raise InvalidInputError(f"ego '{ego.name}' of scenario '{key[0]}' with seed {key[1]} comes twice")
            drives[key] = (digest, ego)
    return drives


def _only_agent(records: Sequence[EpisodeRecord]) -> AgentInfo:
    agents = [ego.agent for record in records for ego in record.egos]
    if not agents:
        raise InvalidInputError("expected at least one record, got none")
    for agent in agents:
        if agent != agents[0]:
            names = sorted({one.name for one in agents})
            raise InvalidInputError(f"expected records of one agent with one set of settings, got {', '.join(names)}")
    return agents[0]


def _only_benchmark(records: Sequence[EpisodeRecord]) -> tuple[str, str] | None:
    benchmarks = {record.benchmark for record in records}
    if len(benchmarks) > 1:
        names = sorted("none" if one is None else f"{one[0]} ({one[1][:12]})" for one in benchmarks)
        raise InvalidInputError(f"expected records of one benchmark version, got {', '.join(names)}")
    return benchmarks.pop()


def _reject_repeats(records: Sequence[EpisodeRecord]) -> None:
    """Refuses drives that come twice: they add no evidence, and would narrow the intervals."""
    hashes = [(record.scenario.content_hash(), record) for record in records]
    for (digest, _), count in Counter((digest, ego.name) for digest, record in hashes for ego in record.egos).items():
        if count > 1:
            scenario = next(record.scenario for found, record in hashes if found == digest)
            raise InvalidInputError(f"scenario '{scenario.name}' with seed {scenario.seed} comes {count} times")
