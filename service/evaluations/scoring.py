"""Summary of an episode in the database: the numbers that pages rank and count by, recomputable from the record.

Records of lots, mornings and days have the reason of an agent's fault and not its kind, which is read beside them once,
when they are staged.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from importlib.metadata import version
from itertools import chain, groupby
from pathlib import Path
from statistics import fmean
from types import MappingProxyType
from typing import Any, Final

from dohyo.evaluation.freeway.day import FORECASTER, METRICS, DayRecord
from dohyo.evaluation.freeway.morning import LOWER_IS_BETTER, PLANNER, MorningRecord
from dohyo.evaluation.freeway.result import root_estimate
from dohyo.evaluation.meetings import hits_of
from dohyo.evaluation.parking.benchmark import LOT
from dohyo.evaluation.parking.record import Ending, ParkingRecord
from dohyo.evaluation.parking.result import MEASURES, LotCounts, count_karts, estimate_measure
from dohyo.evaluation.records.record import EgoRecord, EpisodeRecord, Infraction
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.scores.driving import MIN_KM, Rules, route_km
from dohyo.evaluation.scores.nuplan.score import ClosedLoop
from dohyo.evaluation.scores.nuplan.summary import TERMS, applies, score_records
from dohyo.evaluation.scores.rates import infraction_counts
from dohyo.evaluation.statistics import (
    Comparison,
    Estimate,
    grouped_estimate,
    mean_estimate,
    paired,
    percent_estimate,
    ratio_estimate,
)
from dohyo.evaluation.summary import SHARES, score_drive
from dohyo.service.episodes.archive import Record
from dohyo.service.running.faults import kept_fault

SCORE_KEYS: Final[Mapping[str, str]] = {
    "driving_score": "ds",
    "route_completion": "rc",
    "infraction_penalty": "ip",
    "irs": "irs",
    "success": "success",
    "nocrash_success": "nocrash",
    "road_completed": "road",
    "drove_2500m": "drove",
}
"""Key of each score in a summary, by its name in `dohyo score`."""

CLOSED_LOOP_SCORES: Final = ("closed_loop", *TERMS)
"""Scores of drives whose scenario has a reference, in percent: nuPlan's score, and its terms."""


MORNING_SCORES: Final = ("speed_std_mps", "throughput_vph", "speed_mps", "speed_std_within_mps", "fuel_circles_g_km")
"""Scores of freeway mornings: measures of all vehicles, the headline first."""

FORECAST_SCORES: Final = tuple(metric.key for metric in METRICS)
"""Scores of days of forecasts: errors, the headline first."""
_ROOTS: Final = frozenset(metric.key for metric in METRICS if metric.root)

PARKING_SCORES: Final = tuple(measure.key for measure in MEASURES)
"""Scores of parking lots, the headline first."""

STATUSES: Final[Mapping[Ending, Status]] = {
    "failed": Status.AGENT_RAISED,
    "collided": Status.COLLIDED,
    "timed_out": Status.TIMED_OUT,
    "parked": Status.COMPLETED,
}
"""Statuses of karts' endings, the worst first; a fault has the kind that was kept, see `summary_of_lot`."""


@dataclass(frozen=True)
class Drive:
    """Drive of one ego in one episode, from a summary.

    Attributes:
        episode: Its id.
        scenario: Name.
        cell: Of the benchmark.
        seed: Of the scenario.
        facts: One of the summary's egos, see `summary_of`.
        record_hash: Content hash of the episode's record.
    """

    episode: str
    scenario: str
    cell: str
    seed: int
    facts: Mapping[str, Any]
    record_hash: str | None = None

    @property
    def key(self) -> tuple[str, int, str]:
        """Scenario, seed and ego: drives of two agents with the same key are comparable."""
        return self.scenario, self.seed, self.ego

    @property
    def ego(self) -> str:
        """Name of the ego."""
        return str(self.facts["name"])

    @property
    def status(self) -> Status:
        """How it ended."""
        return Status(self.facts["status"])

    @cached_property
    def lot(self) -> LotCounts | None:
        """The karts of a lot, counted; None for a drive on roads."""
        counts = self.facts.get("parking")
        return None if counts is None else LotCounts(**counts)

    def score(self, name: str) -> float:
        """A score by its name, see `scores_of`: percent, but the infraction penalty in [0, 1].

        NaN is a score of a lot in which no kart parked, if it is one of those that did.
        """
        if self.lot is not None:
            mean = estimate_measure(name, [self.lot]).mean
            return math.nan if mean is None else mean
        if name in MORNING_SCORES:
            return float(self.facts["morning"][name])
        if name in FORECAST_SCORES:
            value = float(self.facts["forecast"][name])
            return math.sqrt(value) if name in _ROOTS else value
        if name in CLOSED_LOOP_SCORES:
            return float(self.facts["closed_loop"][name])
        value = float(self.facts[SCORE_KEYS[name]])
        return 100.0 * value if name in SHARES else value


def is_agent_fault(record: Record) -> bool:
    """Whether an agent failed as a program."""
    if isinstance(record, MorningRecord | DayRecord):
        return record.failure is not None
    if isinstance(record, ParkingRecord):
        return any(one.ending == "failed" for one in record.karts)
    return any(ego.status.agent_fault for ego in record.egos)


def rank_sign(headline: str) -> float:
    """-1 for a headline of which lower values rank higher, else 1."""
    return -1.0 if headline in LOWER_IS_BETTER or headline in FORECAST_SCORES else 1.0


def summary_at(path: Path, record: Record, rules: Rules) -> dict[str, Any]:
    """`summary_of` a staged record, with the closed-loop score where its scenario has a reference.

    Raises:
        InvalidInputError: As `summary_of`, or the trajectory that this score reads is missing or damaged.
    """
    if isinstance(record, MorningRecord):
        return summary_of_morning(record, kept_fault(path))
    if isinstance(record, ParkingRecord):
        return summary_of_lot(record, kept_fault(path))
    if isinstance(record, DayRecord):
        return summary_of_day(record, kept_fault(path))
    scored = score_records([(record, path)]) if applies(record) else []
    return summary_of(record, rules, {drive.ego: drive.terms for drive in scored})


def summary_of(
    record: EpisodeRecord, rules: Rules, closed_loop: Mapping[str, ClosedLoop] = MappingProxyType({})
) -> dict[str, Any]:
    """A record as plain JSON, small enough that a leaderboard reads thousands.

    Args:
        record: Of any status; a lost one is summarised too, and its egos' statuses show it.
        rules: Of the driving score, those of the benchmark.
        closed_loop: By ego, where it has that score.

    Returns:
        `egos`, one per mission: name, status, success, scores in percent (`ip` in [0, 1]), infractions counted by kind,
        `marks` (each infraction's kind, time and place, of a collision also `at_fault`), metres and seconds,
        `closed_loop` where it has that score, by the names in `CLOSED_LOOP_SCORES`, `hits`: its collisions by other
        ego, where there are some; `decision_ms`: the slowest ego's p50, p95, p99, None where the record has no timing;
        `wall_s`; `dohyo`: version of dohyo that drove it.

    Raises:
        InvalidInputError: If a number of the record is not finite.
    """
    timing = record.timing
    decisions: list[tuple[float, float, float]] = [*timing.decision_ms.values()] if timing else []
    hits = hits_of(record)
    return {
        "egos": [
            _ego(ego, rules) | _closed_loop(closed_loop.get(ego.name)) | _hits(hits.get(ego.name))
            for ego in record.egos
        ],
        "decision_ms": [*max(decisions, key=lambda one: one[2])] if decisions else None,
        "wall_s": timing.wall_s if timing else None,
        "dohyo": record.versions.dohyo,
    }


def summary_of_morning(record: MorningRecord, fault: Status = Status.AGENT_RAISED) -> dict[str, Any]:
    """A morning as the summary of one drive, that of its planner.

    Its `morning` has the measures of all vehicles, and `least_throughput_vph` is that of the benchmark.

    Args:
        record: The record.
        fault: How the planner failed, if it did.
    """
    benchmark = record.scenario.benchmark
    duration_s = 0.0 if record.failure is not None else benchmark.duration_s
    facts = {"morning": record.outcome, "least_throughput_vph": benchmark.least_throughput_vph}
    return _summary_without_drives(PLANNER, record, fault, duration_s, facts)


def summary_of_day(record: DayRecord, fault: Status = Status.AGENT_RAISED) -> dict[str, Any]:
    """A day as the summary of one drive, that of its forecaster, with `forecast`: measures by the keys of `METRICS`.

    Args:
        record: The record.
        fault: How the forecaster failed, if it did.
    """
    facts = {"forecast": dict(record.measures), "forecasts": record.forecasts}
    return _summary_without_drives(FORECASTER, record, fault, 60.0 * record.forecasts, facts)


def _summary_without_drives(
    name: str, record: MorningRecord | DayRecord, fault: Status, duration_s: float, facts: Mapping[str, Any]
) -> dict[str, Any]:
    """Summary of one agent that drives nothing."""
    failed = record.failure is not None
    agent = {
        "name": name,
        "status": (fault if failed else Status.FINISHED).value,
        "success": not failed,
        "failure": record.failure,
        **facts,
        "infractions": {},
        "marks": [],
        **dict.fromkeys(("km", "route_m", "driven_m"), 0.0),
        "duration_s": duration_s,
    }
    # Such a record does not say which version drove it; it is summarised when it is made.
    return {"egos": [agent], "decision_ms": None, "wall_s": record.wall_s, "dohyo": version("dohyo")}


def summary_of_lot(record: ParkingRecord, fault: Status = Status.AGENT_RAISED) -> dict[str, Any]:
    """A lot as the summary of one drive, that of all its karts, with `parking`: the fields of `LotCounts`.

    Args:
        record: The record.
        fault: How the agent of the first kart with a fault failed, if one did.
    """
    endings = [one.ending for one in record.karts]
    statuses = (fault if ending == "failed" else status for ending, status in STATUSES.items() if ending in endings)
    lot: dict[str, Any] = {
        "name": LOT,
        "status": next(statuses).value,
        "success": all(one.parked for one in record.karts),
        "failure": next((one.failure for one in record.karts if one.failure is not None), None),
        "parking": asdict(count_karts(record)),
        "infractions": {},
        "marks": [],
        **dict.fromkeys(("km", "route_m"), 0.0),
        "driven_m": math.fsum(one.driven_m for one in record.karts),
        "duration_s": max(one.time_s for one in record.karts),
    }
    return {"egos": [lot], "decision_ms": None, "wall_s": None, "dohyo": record.version}


def scores_of(drives: Iterable[Drive]) -> tuple[str, ...]:
    """Names of the scores that all of some drives have; without any drive, those that every drive has."""
    drives = tuple(drives)
    if any("morning" in drive.facts for drive in drives):
        measured = all(drive.facts["morning"].get(name) is not None for drive in drives for name in MORNING_SCORES)
        return MORNING_SCORES if measured else ()
    if any("forecast" in drive.facts for drive in drives):
        return FORECAST_SCORES if all(drive.facts["forecast"] for drive in drives) else ()
    if any(drive.lot is not None for drive in drives):
        return PARKING_SCORES
    closed_loop = bool(drives) and all("closed_loop" in drive.facts for drive in drives)
    return (*SCORE_KEYS, *(CLOSED_LOOP_SCORES if closed_loop else ()))


def estimate(name: str, drives: Sequence[Drive], lost: Sequence[int] = ()) -> Estimate:
    """Mean of a score over drives, and over lost ones as 0; the interval is Wilson's for shares, else bootstrap.

    Egos of one episode meet each other, so that intervals are over episodes.

    Args:
        name: Name of the score.
        drives: Those that count.
        lost: Number of drives of each lost episode.
    """
    if lots := [drive.lot for drive in drives if drive.lot is not None]:
        return estimate_measure(name, lots)
    if name in _ROOTS:
        return root_estimate(mean_estimate([drive.score(name) ** 2 for drive in drives]))
    episodes = [[drive.score(name) for drive in some] for some in by_episode(drives)]
    return estimate_values(name, [*episodes, *([0.0] * egos for egos in lost)])


def estimate_values(name: str, episodes: Sequence[Sequence[float]]) -> Estimate:
    """Mean of a score of drives on roads or of mornings, from its values in each episode."""
    share = name in SHARES or (name in CLOSED_LOOP_SCORES and {*chain(*episodes)} <= {0.0, 100.0})
    return grouped_estimate(episodes, percent_estimate if share else mean_estimate)


def by_episode(drives: Iterable[Drive]) -> list[list[Drive]]:
    """The drives of each episode."""
    episodes: dict[str, list[Drive]] = {}
    for drive in drives:
        episodes.setdefault(drive.episode, []).append(drive)
    return [*episodes.values()]


def lost_episodes(lost: int, recorded: Iterable[Drive]) -> list[int]:
    """Number of drives of each lost episode; a drive that was lost without a record counts as an episode of its own.

    Args:
        lost: Number of lost drives.
        recorded: Those of them that have a record.
    """
    found = [len(some) for some in by_episode(recorded)]
    return found + [1] * (lost - sum(found))


def summarise_drives(drives: Sequence[Drive], lost: Sequence[int] = ()) -> dict[str, Any]:
    """Scores, infractions per kilometre and endings of drives, as `dohyo score --json` gives them; plain JSON.

    Args:
        drives: Those that count.
        lost: Number of drives of each lost episode, see `lost_episodes`.
    """
    names = scores_of(drives)
    statuses = Counter(drive.status for drive in drives)
    episodes = by_episode(drives)
    km = [math.fsum(drive.facts["km"] for drive in some) for some in episodes]
    return {
        "drives": len(drives),
        "episodes": len(episodes),
        "lost": sum(lost),
        "km": math.fsum(drive.facts["km"] for drive in drives),
        "scores": {name: asdict(estimate(name, drives)) for name in names},
        "scores_lost_as_zero": {name: asdict(estimate(name, drives, lost)) for name in names}
        if lost and names not in (MORNING_SCORES, PARKING_SCORES, FORECAST_SCORES)
        else None,
        "per_km": {
            kind.value: asdict(
                replace(ratio_estimate([_count(kind, some) for some in episodes], km, floor=MIN_KM), n=len(drives))
            )
            for kind in InfractionKind
            if names not in (PARKING_SCORES, FORECAST_SCORES)
        },
        "statuses": {status.value: statuses[status] for status in Status if statuses[status]},
    }


def _count(kind: InfractionKind, drives: Iterable[Drive]) -> int:
    return sum(drive.facts["infractions"].get(kind.value, 0) for drive in drives)


def rates_per_km(drives: Sequence[Drive]) -> dict[str, float]:
    """Infractions of every kind per kilometre of route completed, pooled; kinds that never happened left out."""
    km = max(MIN_KM, math.fsum(drive.facts["km"] for drive in drives))
    counts: Counter[str] = Counter()
    for drive in drives:
        counts.update(drive.facts["infractions"])
    return {kind.value: counts[kind.value] / km for kind in InfractionKind if counts[kind.value]}


def compare_drives(name: str, ours: Iterable[Drive], theirs: Iterable[Drive]) -> Comparison | None:
    """How a score differs on the drives both made, ours - theirs; None where there is no such drive.

    The egos of one episode are one pair, by their means.
    """
    a, b = ({drive.key: drive.score(name) for drive in side} for side in (ours, theirs))
    keys = sorted(key for key in a.keys() & b.keys() if math.isfinite(a[key]) and math.isfinite(b[key]))
    episodes = [[*some] for _, some in groupby(keys, lambda key: key[:2])]
    means = [[fmean(side[key] for key in some) for some in episodes] for side in (a, b)]
    return paired(*means) if keys else None


def _ego(ego: EgoRecord, rules: Rules) -> dict[str, Any]:
    scores = score_drive(ego, rules=rules)
    return {
        "name": ego.name,
        "status": ego.status.value,
        "success": scores["success"] > 0.0,
        "nocrash": scores["nocrash_success"] > 0.0,
        "ds": scores["driving_score"],
        "rc": scores["route_completion"],
        "ip": scores["infraction_penalty"],
        "irs": scores["irs"],
        "road": scores["road_completed"],
        "drove": scores["drove_2500m"] > 0.0,
        "infractions": {kind.value: count for kind, count in infraction_counts(ego).items() if count},
        "marks": [_mark(one) for one in ego.infractions],
        "km": route_km(ego),
        "route_m": ego.route_length_m,
        "driven_m": ego.driven_m,
        "duration_s": ego.duration_s,
    }


def _closed_loop(terms: ClosedLoop | None) -> dict[str, Any]:
    if terms is None:
        return {}
    return {"closed_loop": {"closed_loop": terms.score} | {name: 100.0 * getattr(terms, name) for name in TERMS}}


def _hits(others: Mapping[str, int] | None) -> dict[str, Any]:
    return {"hits": dict(others)} if others else {}


def _mark(one: Infraction) -> dict[str, Any]:
    places = {name: round(getattr(one, name), 2) for name in ("time_s", "x_m", "y_m", "route_m")}
    fault = {} if one.at_fault is None else {"at_fault": one.at_fault}
    return {"kind": one.kind.value, **places, **fault}
