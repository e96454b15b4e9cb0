"""Closed-loop summary: nuPlan's score of an agent's records, over all drives and by type of scenario."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.roads import check_roads
from dohyo.evaluation.records.store import read_trajectory
from dohyo.evaluation.scores.nuplan.score import ClosedLoop, closed_loop
from dohyo.evaluation.statistics import Comparison, Estimate, mean_estimate, paired, share_estimate
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network

TERMS = (
    "no_collision",
    "drivable_area",
    "driving_direction",
    "making_progress",
    "time_to_collision",
    "speed_limit",
    "progress",
    "comfort",
)


@dataclass(frozen=True, slots=True)
class ScoredDrive:
    """One drive and its terms.

    Attributes:
        scenario: Name of the scenario.
        seed: Seed of the scenario.
        ego: Name of the ego's mission.
        kind: Type of the scenario, which is the name of its cell up to the first dot.
        terms: Terms of the score.
    """

    scenario: str
    seed: int
    ego: str
    kind: str
    terms: ClosedLoop


@dataclass(frozen=True, slots=True)
class ClosedLoopSummary:
    """Means over drives, in percent, with their intervals.

    Attributes:
        score: Closed-loop score; lost drives are left out.
        score_lost_as_zero: Closed-loop score with every lost drive counting 0, as in nuPlan; None if no drive was lost.
        collisions: CR, 100 x (1 - mean NC); lower is better.
        off_road: DA, 100 x (1 - mean DAC); lower is better.
        progress: EP, 100 x mean EP.
        terms: 100 x the mean of each of `TERMS`.
        red_lights: Number of red lights crossed in all drives, which enters no score.
        drives: Number of drives.
        lost: Number of drives lost to gridlocks and infrastructure faults.
    """

    score: Estimate
    score_lost_as_zero: Estimate | None
    collisions: Estimate
    off_road: Estimate
    progress: Estimate
    terms: dict[str, Estimate]
    red_lights: int
    drives: int
    lost: int


def applies(record: EpisodeRecord) -> bool:
    """Whether a record has a closed-loop score, which needs the reference's progress in its scenario."""
    return record.scenario.reference_m is not None


def score_records(records: Iterable[tuple[EpisodeRecord, Path]]) -> list[ScoredDrive]:
    """Scores every drive of every record; lost episodes are left out.

    Raises:
        InvalidInputError: A scenario has no reference, a trajectory is missing or damaged, or the network here is
            another one than the record's.
    """
    found = []
    for record, path in records:
        scenario = record.scenario
        if scenario.reference_m is None:
            raise InvalidInputError(f"scenario '{scenario.name}' has no reference; no closed-loop score without one")
        if record.lost:
            continue
        network, trajectory = load_network(scenario.network), read_trajectory(path)
        check_roads(record, network)
        for ego, facts in enumerate(record.egos):
            terms = closed_loop(record, trajectory, network, scenario.reference_m, ego)
            kind = scenario.cell.partition(".")[0]
            found.append(ScoredDrive(scenario.name, scenario.seed, facts.name, kind, terms))
    return found


def summarise_closed_loop(drives: Sequence[ScoredDrive], lost: int = 0) -> ClosedLoopSummary:
    """Means of the scored drives, and the score that also counts the lost drives as 0."""

    def mean(value: Callable[[ClosedLoop], float]) -> Estimate:
        return _estimate([value(one.terms) for one in drives])

    return ClosedLoopSummary(
        score=mean(lambda terms: terms.score),
        score_lost_as_zero=_estimate([one.terms.score for one in drives] + [0.0] * lost) if lost else None,
        collisions=mean(lambda terms: 100.0 * (1.0 - terms.no_collision)),
        off_road=mean(lambda terms: 100.0 * (1.0 - terms.drivable_area)),
        progress=mean(lambda terms: 100.0 * terms.progress),
        terms={name: _estimate([100.0 * getattr(one.terms, name) for one in drives]) for name in TERMS},
        red_lights=sum(one.terms.red_lights for one in drives),
        drives=len(drives),
        lost=lost,
    )


def _estimate(percents: Sequence[float]) -> Estimate:
    """Mean with its interval; a share has Wilson's interval, since resampling shows no spread at 0 and 100 %."""
    if all(value in (0.0, 100.0) for value in percents):
        return share_estimate([value > 0.0 for value in percents])
    return mean_estimate(percents)


def by_type(drives: Sequence[ScoredDrive]) -> dict[str, ClosedLoopSummary]:
    """One summary per type of scenario, in the order of their first drives."""
    kinds: dict[str, list[ScoredDrive]] = {}
    for drive in drives:
        kinds.setdefault(drive.kind, []).append(drive)
    return {kind: summarise_closed_loop(some) for kind, some in kinds.items()}


def compare_closed_loop(a: Sequence[ScoredDrive], b: Sequence[ScoredDrive]) -> Comparison:
    """Compares the scores of two agents (a - b) on the drives of both.

    Raises:
        InvalidInputError: No drive is common to both.
    """
    first, second = ({(one.scenario, one.seed, one.ego): one.terms.score for one in side} for side in (a, b))
    keys = sorted(first.keys() & second.keys())
    return paired([first[key] for key in keys], [second[key] for key in keys])


def lost_drives(records: Iterable[EpisodeRecord]) -> int:
    """Number of drives in episodes that were lost."""
    return sum(len(record.egos) for record in records if record.lost)


def as_document(drives: Sequence[ScoredDrive], lost: int = 0) -> dict[str, Any]:
    """Summary, types and drives as plain JSON."""
    return {
        "summary": dataclasses.asdict(summarise_closed_loop(drives, lost)),
        "types": {kind: dataclasses.asdict(one) for kind, one in by_type(drives).items()},
        "drives": [
            dataclasses.asdict(one) | {"score": one.terms.score, "multiplier": one.terms.multiplier} for one in drives
        ],
    }
