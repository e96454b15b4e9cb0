"""Tables of a study of endless driving: trainings, success in the unseen town, infractions per km, lateral offsets."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Final

import numpy as np

from dohyo.agents.endless_driving.study.arms import DrivingArm
from dohyo.agents.endless_driving.study.judging import EDGES_M
from dohyo.agents.studies.claims import Claim, Judgement, judge
from dohyo.agents.studies.crossed_bootstrap import Matched, estimate
from dohyo.agents.studies.rows import Row, arms_in, infractions_per_km, is_lost, matched
from dohyo.agents.studies.study import Results
from dohyo.agents.studies.tables import claims_table, fixed
from dohyo.agents.studies.training_results import BENCHMARK as TRAINING
from dohyo.evaluation.report.style import MISSING, markdown
from dohyo.evaluation.statistics import mean_estimate

Claims = Sequence[Claim]
Arms = Mapping[str, DrivingArm]
TRAFFIC: Final = ("empty", "regular", "dense")
PER_KM: Final = {
    "collision_pedestrian": "people/km",
    "collision_vehicle": "vehicles/km",
    "collision_static": "layout/km",
    "red_light": "red/km",
    "blocked": "blocked/km",
}
LAST: Final = {
    "return": "return",
    "success": "success, %",
    "completion": "completion, %",
    "lateral_m": "lateral, m",
    "slope": "slope, per 10,000 steps",
    "expert_share": "expert's share",
}


def tables_of(arms: Arms, claims: Claims) -> Mapping[str, Callable[[Results], str]]:
    """The sections of a system's RESULTS.md."""
    return {
        "trainings": partial(trainings_table, arms),
        "success": partial(success_table, arms),
        "claims": partial(claims_section, claims),
        "infractions": partial(infractions_table, arms),
        "lateral": partial(lateral_table, arms),
    }


def trainings_table(arms: Arms, results: Results) -> str:
    """A row per training: its last evaluation on its own held-out missions."""
    lines = []
    rows = [row for row in results.rows if row["benchmark"] == TRAINING and not is_lost(row)]
    for arm in arms_in(rows, [*arms]):
        for row in (row for row in rows if row["arm"] == arm):
            steps = f"{row['steps']:,}" + ("" if row["finished"] else ", unfinished")
            shown = [MISSING if row[name] is None else f"{row[name]:.3g}" for name in LAST]
            facts = [f"{row['training_seed']}", steps, f"{row['updates']:,}", f"{row['tier']}"]
            lines.append([arm, arms[arm].isolates or MISSING, *facts, *shown])
    return markdown(["arm", "difference", "seed", "steps", "updates", "tier", *LAST.values()], lines) if lines else ""


def success_table(arms: Arms, results: Results) -> str:
    """A row per arm: success by traffic, and without any red light or stop sign run, beside the thesis's."""
    lines, rows = [], driven(results)
    for arm in arms_in(rows, [*arms]):
        own = [row for row in rows if row["arm"] == arm]
        shown = [_share(own, arm, measure, traffic) for measure in ("success", "lawful_success") for traffic in TRAFFIC]
        told = " / ".join(MISSING if value is None else f"{value:g}" for value in arms[arm].reported)
        count = len({row["training_seed"] for row in own})
        decision = float(np.median([row["decision_ms"] for row in own]))
        lines.append([arm, f"{count}", f"{len(own)}", *shown, f"{decision:.1f}", told])
    heads = [f"{what}{traffic}, %" for what in ("", "lawful, ") for traffic in TRAFFIC]
    titles = ["arm", "trainings", "drives", *heads, "ms per decision", "thesis: " + " / ".join(TRAFFIC)]
    return markdown(titles, lines) if lines else ""


def judged(claims: Claims, results: Results) -> list[Judgement]:
    """The thesis's order of the arms, on trainings or on drives of the unseen town."""

    def values(claim: Claim, arm: str) -> Matched:
        if claim.where == TRAINING:
            return matched((row for row in results.rows if row["benchmark"] == TRAINING), arm, claim.measure)
        return matched(of_traffic(driven(results), claim.where), arm, claim.measure)

    return judge(claims, values)


def claims_section(claims: Claims, results: Results) -> str:
    """Verdicts on the thesis's order of the arms."""
    before = {
        "claim": lambda one: str(one.claim),
        "where": lambda one: one.claim.where,
        "measure": lambda one: one.claim.measure,
    }
    return claims_table(judged(claims, results), before, lambda one: fixed(one.difference))


def infractions_table(arms: Arms, results: Results) -> str:
    """Infractions per km driven in regular traffic, pooled over the drives of an arm."""
    lines, rows = [], of_traffic(driven(results), "regular")
    for arm in arms_in(rows, [*arms]):
        own = [row for row in rows if row["arm"] == arm]
        km, found = infractions_per_km(own)
        completion = math.fsum(row["route_completion"] for row in own) / len(own)
        rates = [f"{found[kind]:.2f}" for kind in PER_KM]
        lines.append([arm, f"{completion:.1f}", f"{km:.1f}", *rates])
    return markdown(["arm", "completion, %", "km", *PER_KM.values()], lines) if lines else ""


def lateral_table(arms: Arms, results: Results) -> str:
    """Share of the time by the distance beside the route, in all traffic, %."""
    lines, rows = [], driven(results)
    for arm in arms_in(rows, [*arms]):
        ticks = np.sum([row["lateral_ticks"] for row in rows if row["arm"] == arm], axis=0)
        lines.append([arm, *(f"{share:.1f}" for share in 100.0 * ticks / max(ticks.sum(), 1))])
    ends = [f"to {edge:g} m" for edge in EDGES_M[1:]]
    return markdown(["arm", *ends, "beyond"], lines) if lines else ""


def driven(results: Results) -> list[Row]:
    """Rows of drives in the unseen town."""
    return [row for row in results.rows if row["benchmark"] != TRAINING and not is_lost(row)]


def of_traffic(rows: Iterable[Row], traffic: str) -> list[Row]:
    """Rows of one amount of traffic, which the scenario's name has."""
    return [row for row in rows if f".{traffic}." in row["scenario"]]


def _share(rows: Iterable[Row], arm: str, measure: str, traffic: str) -> str:
    values = matched(of_traffic(rows, traffic), arm, measure)
    return fixed(estimate(values, mean_estimate)) if values else MISSING
