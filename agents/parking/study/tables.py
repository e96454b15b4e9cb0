"""Tables of the parking study."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Final

from dohyo.agents.parking.study.arms import ARMS, REACHED
from dohyo.agents.parking.study.judging import LOTS
from dohyo.agents.studies.claims import Claim, Judgement, holm, judge_rows, of_ablation, verdict
from dohyo.agents.studies.crossed_bootstrap import Matched
from dohyo.agents.studies.rows import Row, by_arm, grouped, matched
from dohyo.agents.studies.study import Results
from dohyo.agents.studies.tables import claims_section, mean_of
from dohyo.evaluation.report.style import MISSING, markdown
from dohyo.evaluation.statistics import Estimate, mean_estimate, share_estimate

SHOWN: Final = {
    "success": "success, %",
    "aligned": "aligned, % of successes",
    "collided": "contacts, %",
    "timed_out": "out of time, %",
    "time_s": "time, s",
}
OF_SUCCESSES: Final = {"aligned", "time_s"}
"""Measures of the karts that parked; blocks without one have no value."""
STEPS: Final = "threshold_steps"
CLAIMS: Final = (
    Claim("simple-ppo", ">", "simple-sac", "success", REACHED),
    Claim("simple-poca", ">", "simple-sac", "success", REACHED),
    *of_ablation(
        22,  # Added after the trainings, whose curves had been seen.
        Claim("simple-ppo", "<", "simple-poca", STEPS, REACHED),
        Claim("simple-sac", ">", "simple-ppo", STEPS, REACHED),
        Claim("simple-sac", ">", "simple-poca", STEPS, REACHED),
    ),
    *of_ablation(
        23,
        Claim("dppo", ">", "ppo", "success", "parking-complex"),
        Claim("dppo-gail", ">", "dppo", "success", "parking-complex"),
        Claim("dppo-il", ">", "dppo-gail", "success", "parking-complex"),
    ),
    *of_ablation(
        24,
        Claim("three-curriculum", ">", "three", "success", "parking-three"),
        Claim("three-curriculum", ">", "three", "aligned", "parking-three"),
        Claim("three-curriculum-long", ">", "three-long", "success", "parking-three"),
        Claim("three-curriculum-long", ">", "three-long", "aligned", "parking-three"),
    ),
    *of_ablation(
        25,
        Claim("dppo-il", ">", "without-alignment", "aligned", "parking-complex"),
        Claim("dppo-il", ">", "without-dwell", "aligned", "parking-complex"),
    ),
    Claim("graded-long", ">", "graded", "aligned", "parking-complex"),
    Claim("three-longest", ">", "three-long", "aligned", "parking-three"),
    Claim("graded", ">", "dppo-il", "aligned", "parking-complex"),
)
"""Directions of the thesis's results."""


def _values(rows: Iterable[Row], arm: str, measure: str) -> Matched:
    """Values by block of lots; steps to the threshold are one value of each training.

    A training that never reaches it counts with all of its steps, a lower bound; see `_by_ranks`.
    """
    if measure != STEPS:
        return matched(rows, arm, measure)
    own = (row for row in rows if row["arm"] == arm)
    return {(STEPS,): {row["training_seed"]: float(row[STEPS] or row["steps"]) for row in own}}


def judged(results: Results) -> list[Judgement]:
    """Judges all claims together; those on steps that a training never reached by ranks."""
    found = [_by_ranks(one, results.kept) for one in judge_rows(CLAIMS, results.rows, values=_values)]
    return [
        replace(one, adjusted=p, verdict=verdict(one.claim.relation, one.difference.mean or 0.0, p))
        for one, p in zip(found, holm([one.p for one in found]), strict=True)
    ]


def _by_ranks(one: Judgement, rows: Iterable[Row]) -> Judgement:
    """Judgement by the order in which trainings reach the threshold, where one never does; else as it is.

    Such a training has no number of steps: its bound says nothing of the spread, on which a t-test rests. Within the
    steps that all of them took, trainings that have not reached it are equal. The difference is a bound without an
    interval; it is none where trainings of both arms never reach it.
    """
    claim = one.claim
    if claim.measure != STEPS:
        return one
    there = grouped((row for row in rows if row["benchmark"] == claim.where), "arm")
    arms = [{row["training_seed"]: row for row in there[arm]}.values() for arm in (claim.left, claim.right)]
    never = [any(row[STEPS] is None for row in arm) for arm in arms]
    if not any(never):
        return one
    shortest = min(row["steps"] for arm in arms for row in arm)
    reached = [[row[STEPS] or math.inf for row in arm] for arm in arms]
    left, right = ([at if at <= shortest else math.inf for at in arm] for arm in reached)
    bound = "no bound" if all(never) else "at least" if never[0] else "at most"
    return replace(
        one,
        claim=replace(claim, told=f"{claim} ({bound}: not all trainings reach it)"),
        difference=Estimate(one.difference.mean, None, None, one.difference.n),
        p=1.0 if one.few_trainings else rank_test(left, right),
    )


def rank_test(left: Sequence[float], right: Sequence[float]) -> float:
    """Two-sided p-value of the order of two samples: the share of all divisions whose rank sums are as far apart.

    Source: Wilcoxon 1945, exact, with mean ranks of equal values.
    """
    pooled = [*left, *right]
    ranks = [sum(other < one for other in pooled) + sum(other == one for other in pooled) / 2 for one in pooled]
    middle = len(left) * sum(ranks) / len(ranks)
    far = [abs(sum(some) - middle) for some in combinations(ranks, len(left))]
    return sum(one >= abs(sum(ranks[: len(left)]) - middle) - 1e-9 for one in far) / len(far)


claims = claims_section(judged, ("claim", "measure"))


def arms_table(results: Results) -> str:
    """A row per arm and benchmark."""
    lines = []
    for arm, own in by_arm(results.kept, ARMS).items():
        for benchmark, some in grouped(own, "benchmark").items():
            means = [_mean(some, arm, measure) for measure in SHOWN]
            reported = ARMS[arm].reported
            said = MISSING if reported is None or benchmark != ARMS[arm].benchmarks[0] else f"{reported:g}"
            own_place = benchmark == ARMS[arm].benchmarks[0]
            lines.append([arm, benchmark, *_trained(some, own_place), *means, said])
    reached = "steps to 90 % by its own reward and lots"
    heads = ["arm", "benchmark", "trainings", "steps", reached, *SHOWN.values(), "thesis: success, %"]
    return markdown(heads, lines) if lines else ""


def _mean(rows: Sequence[Row], arm: str, measure: str) -> str:
    """Mean of a measure, and of how many trainings where some have no value."""
    told = [row for row in rows if row[measure] is not None]
    alone = partial(_of_blocks, count=_judged_lots(told, measure))
    having, every = ({row["training_seed"] for row in some} for some in (told, rows))
    of = f", {len(having)} of {len(every)} trainings" if 0 < len(having) < len(every) else ""
    return mean_of(told, arm, measure, alone=alone) + of


def _judged_lots(rows: Iterable[Row], measure: str) -> int:
    """Lots that a measure was taken in: those parked in for what is of successes, else all.

    A block that several trainings drove counts once, as the one with most; karts of one lot count as one.
    """
    found: dict[str, int] = {}
    for row in rows:
        lots = round(LOTS * row["success"] / 100.0) if measure in OF_SUCCESSES else LOTS
        found[row["scenario"]] = max(found.get(row["scenario"], 0), lots)
    return sum(found.values())


def _of_blocks(values: Sequence[float], count: int) -> Estimate:
    """Mean over blocks of lots; a share that is 0 or 100 % in all of them has Wilson's interval over `count` lots."""
    if set(values) in ({0.0}, {100.0}):
        return share_estimate([values[0] == 100.0] * count)
    return mean_estimate(values)


def _trained(rows: Sequence[Row], own_place: bool) -> list[str]:
    """Trainings of an arm, their steps, and, where it was trained for the place, their steps to the threshold."""
    trainings = {row["training_seed"]: row for row in rows if row["training_seed"] is not None}.values()
    if not trainings:
        return [MISSING] * 3
    open_ = sum(not row["finished"] for row in trainings)
    count = f"{len(trainings)}" + (f", {open_} unfinished" if open_ else "")
    steps = [row["threshold_steps"] for row in trainings]
    reached = ", ".join("never" if at is None else f"{at:,}" for at in steps) if own_place else MISSING
    return [count, ", ".join(f"{row['steps']:,}" for row in trainings), reached]
