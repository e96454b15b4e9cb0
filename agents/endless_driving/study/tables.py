"""Tables of a study of endless driving: trainings, success in the unseen town, infractions per km, lateral offsets."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Final

import numpy as np

from dohyo.agents.endless_driving.study.arms import DrivingArm
from dohyo.agents.endless_driving.study.judging import EDGES_M
from dohyo.agents.studies.claims import Claim, Judgement
from dohyo.agents.studies.crossed_bootstrap import of_shares
from dohyo.agents.studies.rows import Row, by_arm, infractions_per_km
from dohyo.agents.studies.study import Results, judging
from dohyo.agents.studies.tables import claims_section, mean_of, rounded
from dohyo.agents.studies.training_results import BENCHMARK as TRAINING
from dohyo.evaluation.report.style import MISSING, markdown

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
        "claims": claims_section(judged(claims), shown=rounded),
        "infractions": partial(infractions_table, arms),
        "lateral": partial(lateral_table, arms),
    }


def trainings_table(arms: Arms, results: Results) -> str:
    """A row per training: its last evaluation on its own held-out missions."""
    lines = []
    for arm, own in by_arm((row for row in results.kept if row["benchmark"] == TRAINING), arms).items():
        for row in own:
            steps = f"{row['steps']:,}" + ("" if row["finished"] else ", unfinished")
            shown = [MISSING if row[name] is None else f"{row[name]:.3g}" for name in LAST]
            facts = [f"{row['training_seed']}", steps, f"{row['updates']:,}", f"{row['tier']}"]
            lines.append([arm, arms[arm].isolates or MISSING, *facts, *shown])
    return markdown(["arm", "difference", "seed", "steps", "updates", "tier", *LAST.values()], lines) if lines else ""


def success_table(arms: Arms, results: Results) -> str:
    """A row per arm: success by traffic, and without any red light or stop sign run, beside the thesis's."""
    lines = []
    for arm, own in by_arm(driven(results), arms).items():
        shown = [
            mean_of(of_traffic(own, traffic), arm, measure, alone=of_shares)
            for measure in ("success", "lawful_success")
            for traffic in TRAFFIC
        ]
        told = " / ".join(MISSING if value is None else f"{value:g}" for value in arms[arm].reported)
        count = len({row["training_seed"] for row in own})
        decision = float(np.median([row["decision_ms"] for row in own]))
        lines.append([arm, f"{count}", f"{len(own)}", *shown, f"{decision:.1f}", told])
    heads = [f"{what}{traffic}, %" for what in ("", "lawful, ") for traffic in TRAFFIC]
    titles = ["arm", "trainings", "drives", *heads, "ms per decision", "thesis: " + " / ".join(TRAFFIC)]
    return markdown(titles, lines) if lines else ""


def judged(claims: Claims) -> Callable[[Results], list[Judgement]]:
    """The thesis's order of the arms, on trainings or on drives of the unseen town."""
    return judging(claims, at=lambda row, where: where in (row["benchmark"], _traffic(row)))


def infractions_table(arms: Arms, results: Results) -> str:
    """Infractions per km driven in regular traffic, pooled over the drives of an arm."""
    lines = []
    for arm, own in by_arm(of_traffic(driven(results), "regular"), arms).items():
        km, found = infractions_per_km(own)
        completion = math.fsum(row["route_completion"] for row in own) / len(own)
        rates = [f"{found[kind]:.2f}" for kind in PER_KM]
        lines.append([arm, f"{completion:.1f}", f"{km:.1f}", *rates])
    return markdown(["arm", "completion, %", "km", *PER_KM.values()], lines) if lines else ""


def lateral_table(arms: Arms, results: Results) -> str:
    """Share of the time by the distance beside the route, in all traffic, %."""
    lines = []
    for arm, own in by_arm(driven(results), arms).items():
        ticks = np.sum([row["lateral_ticks"] for row in own], axis=0)
        lines.append([arm, *(f"{share:.1f}" for share in 100.0 * ticks / max(ticks.sum(), 1))])
    ends = [f"to {edge:g} m" for edge in EDGES_M[1:]]
    return markdown(["arm", *ends, "beyond"], lines) if lines else ""


def driven(results: Results) -> list[Row]:
    """Rows of drives in the unseen town."""
    return [row for row in results.kept if row["benchmark"] != TRAINING]


def of_traffic(rows: Iterable[Row], traffic: str) -> list[Row]:
    """Rows of one amount of traffic."""
    return [row for row in rows if _traffic(row) == traffic]


def _traffic(row: Row) -> str:
    """Amount of traffic of a drive, which the scenario's name has, such as "town-test.dense.test.m00"."""
    return ".".join(row["scenario"].split(".")[1:2])
