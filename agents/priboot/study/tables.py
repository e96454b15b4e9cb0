"""Tables of the study of PRIBOOT as Markdown: arms, claims, infractions per km, and scores by the route's length."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from dohyo.agents.priboot.study import lengths
from dohyo.agents.priboot.study.arms import ARMS
from dohyo.agents.studies.claims import Claim, Judgement, judge_rows
from dohyo.agents.studies.crossed_bootstrap import of_shares
from dohyo.agents.studies.rows import Row, by_place, infractions_per_km
from dohyo.agents.studies.study import Results
from dohyo.agents.studies.tables import claims_section, mean_of, rounded
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.report.style import MISSING, markdown
from dohyo.evaluation.statistics import mean_estimate

MEASURES: Final[Mapping[str, str]] = {
    "driving_score": "DS, %",
    "irs": "IRS, L driven, %",
    "irs_route": "IRS, L route, %",
    "route_completion": "RC, %",
    "infraction_penalty": "IP",
    "nocrash_success": "NoCrash success, %",
}
LOSSES: Final[Mapping[str, str]] = {"validation_loss": "loss", "displaced_loss": "loss, displaced"}
STARTS: Final[Mapping[str, str]] = {"starts": "starts, %", "false_starts": "false starts, %"}
"""Shares of the standing moments of held-out drives at which the network starts, of those where the expert does and of
the others."""
CLAIMS: Final = tuple(
    Claim("full", ">", arm, measure, where, ablation=19)
    for where in ("nocrash", "leaderboard")
    for arm, measure in (
        ("no-augmentation", "route_completion"),
        ("no-augmentation", "driving_score"),
        ("masks", "route_completion"),
        ("no-rules", "driving_score"),
        ("data-10", "driving_score"),
    )
)


def judged(results: Results) -> list[Judgement]:
    """All claims on the drives, and on the same drives joined in pairs."""
    rows = results.kept
    return judge_rows((*CLAIMS, *lengths.CLAIMS), (*rows, *lengths.in_pairs(rows)))


claims = claims_section(
    judged, ("claim", "benchmark", "measure", "n"), rounded, {"measure": lambda one: MEASURES[one.claim.measure]}
)


def arms_table(results: Results) -> str:
    """A row per arm and network."""
    lines = []
    for network, arm, own in by_place(results.kept, ARMS):
        scores = [_mean(own, arm, name) for name in MEASURES]
        thesis = ARMS[arm].reported if network == "leaderboard" else None
        told = MISSING if thesis is None else " / ".join(f"{value:g}" for value in thesis)
        lines.append([network, arm, ARMS[arm].isolates or MISSING, *scores, *_losses(own), str(len(own)), told])
    heads = ["benchmark", "arm", "difference", *MEASURES.values(), *LOSSES.values(), *STARTS.values(), "drives"]
    return markdown([*heads, "thesis: DS / IRS / RC"], lines) if lines else ""


def infractions_table(results: Results) -> str:
    """Infractions per km driven, and the mean speed, pooled over the drives of an arm."""
    lines, rows = [], results.kept
    seen = [kind.value for kind in InfractionKind if any(kind.value in row["infractions"] for row in rows)]
    for network, arm, own in by_place(rows, ARMS):
        km, rates = infractions_per_km(own)
        endings = Counter(row["status"] for row in own)
        told = ", ".join(f"{count} {status.removeprefix('failed: ')}" for status, count in endings.most_common())
        speed = 1000.0 * km / max(math.fsum(row["duration_s"] for row in own), 0.1)
        lines.append([network, arm, f"{km:.1f}", f"{speed:.1f}", *(f"{rates[kind]:.2f}" for kind in seen), told])
    return markdown(["benchmark", "arm", "km", "mean speed, m/s", *seen, "endings"], lines) if lines else ""


def lengths_table(results: Results) -> str:
    """Scores of routes that are drives of one arm joined end to end: the same driving, more of it."""
    lines = []
    for network, arm, own in by_place(results.kept, ARMS):
        scores = [lengths.joined(own, count) for count in lengths.JOINED]
        for which, head in enumerate(lengths.SCORES):
            digits = 2 if head == "IP" else 1
            lines.append([network, arm, head, *(f"{one[which]:.{digits}f}" for one in scores)])
    heads = ["benchmark", "arm", "score", *(f"x {count}" for count in lengths.JOINED)]
    return markdown(heads, lines) if lines else ""


def _mean(rows: Sequence[Row], arm: str, measure: str) -> str:
    """Mean of a measure of some drives, with its interval."""
    digits = 2 if measure == "infraction_penalty" else 1
    return mean_of(rows, arm, measure, digits, of_shares if measure == "nocrash_success" else mean_estimate)


def _losses(rows: Sequence[Row]) -> list[str]:
    """Mean measures of the trainings on held-out drives."""
    trainings = {row["training_seed"]: row for row in rows if row["training_seed"] is not None}.values()
    found = {name: [row[name] for row in trainings if name in row] for name in (*LOSSES, *STARTS)}
    scale = {name: 100.0 if name in STARTS else 1.0 for name in found}
    return [
        f"{scale[name] * np.mean(values):.{0 if name in STARTS else 2}f}" if values else MISSING
        for name, values in found.items()
    ]
