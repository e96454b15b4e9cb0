"""Tables of GHRL's sub-policies on held-out exercises, and their claims."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from dohyo.agents.hierarchical.study.arms import ARMS, SUB_POLICIES
from dohyo.agents.studies.claims import Claim, Relation
from dohyo.agents.studies.crossed_bootstrap import by_training, estimate
from dohyo.agents.studies.rows import by_arm, grouped, matched
from dohyo.agents.studies.study import Results, judging
from dohyo.agents.studies.tables import claims_table
from dohyo.evaluation.report.style import interval, markdown

MEASURES: Final[Mapping[str, tuple[str, Relation]]] = {
    "return": ("return", ">"), "success": ("success, %", ">"), "infraction": ("infractions, %", "<"),
}  # fmt: skip
"""Heads, and what a better arm has."""
_PAIRS: Final = (
    ("p-5", "hrl", 27), ("p-10", "hrl", 27), ("p-20", "hrl", 27), ("p-20", "p-5", 27), ("p-10", "p-10-sum", 28),
    ("ghrl", "p-10", 0), ("ghrl", "ghrl-pictures", 0),
)  # fmt: skip
CLAIMS: Final = [
    Claim(left, relation, right, measure, policy, ablation=number)
    for policy in SUB_POLICIES
    for left, right, number in _PAIRS
    for measure, (_, relation) in MEASURES.items()
]
"""The first arm is better, for each sub-policy and measure."""
judged = judging(CLAIMS)


def tables(results: Results) -> str:
    """Results of each arm, and claims, as Markdown."""
    means, by_policy = [], grouped(results.rows, "benchmark")
    for policy in SUB_POLICIES:
        for arm, rows in by_arm(by_policy.get(policy, ()), ARMS).items():
            values = [matched(rows, arm, measure) for measure in MEASURES]
            trainings = ", ".join(map(str, by_training(values[0])))
            means.append([policy, arm, trainings, *(interval(estimate(some)) for some in values)])
    heads = ["policy", "arm", "trainings", *(head for head, _ in MEASURES.values())]
    more = {"of": lambda one: MEASURES[one.claim.measure][0]}
    claims = claims_table(judged(results), ("policy", "claim", "of", "each training"), more=more)
    return "\n\n".join(part for part in (markdown(heads, means), claims) if part)
