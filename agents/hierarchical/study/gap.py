"""Gap of generalisation: success where the policies learned, and in a town or conditions that they never saw."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from dohyo.agents.hierarchical.study.tables import is_lawful
from dohyo.agents.studies.rows import Row, grouped
from dohyo.agents.studies.study import Results
from dohyo.agents.studies.tables import fixed
from dohyo.evaluation.report.style import markdown
from dohyo.evaluation.statistics import N_RESAMPLES, SEED, Estimate, share_estimate

SEEN: Final = "train"
SHIPPED: Final = 0
"""Seed of the training that drove all cells."""
PLACES: Final = {
    "both seen": (True, True),
    "unseen conditions": (True, False),
    "unseen town": (False, True),
    "both unseen": (False, False),
}
"""Whether the town and the conditions are those of the training."""
OUTCOMES: Final = {"success, %": lambda row: bool(row["success"]), "lawful success, %": is_lawful}


def gap_section(results: Results) -> str:
    """A row per arm and outcome, of the arms that drove NoCrash in both towns; "" without any.

    Missions of the two towns are different ones, so that the gap's interval resamples both sides independently.
    """
    rows = [row for row in results.kept if row["benchmark"] == "nocrash" and row["seed"] == 0]
    lines = []
    for arm, own in grouped((row for row in rows if row["training_seed"] in (None, SHIPPED)), "arm").items():
        groups = [[row for row in own if _place(row) == place] for place in PLACES.values()]
        if not all(groups):
            continue
        for head, outcome in OUTCOMES.items():
            outcomes = [[outcome(row) for row in group] for group in groups]
            shares = [fixed(share_estimate(some)) for some in outcomes]
            lines.append([arm, head, *shares, fixed(gap(outcomes[0], outcomes[-1]))])
    heads = ["arm", "NoCrash", *PLACES, "gap: both seen less both unseen"]
    return markdown(heads, lines) if lines else ""


def gap(seen: Sequence[bool], unseen: Sequence[bool]) -> Estimate:
    """Difference of two shares in points, with the interval of independent resamples."""
    generator = np.random.default_rng(SEED)
    shares = [
        100.0 * generator.binomial(len(some), sum(some) / len(some), N_RESAMPLES) / len(some) for some in (seen, unseen)
    ]
    low, high = np.quantile(shares[0] - shares[1], (0.025, 0.975))
    mean = 100.0 * (sum(seen) / len(seen) - sum(unseen) / len(unseen))
    return Estimate(mean, float(low), float(high), len(seen) + len(unseen))


def _place(row: Row) -> tuple[bool, bool]:
    """Whether town and conditions are those of the training; a cell is "town-train.dense.test", say."""
    town, _, conditions = row["cell"].split(".")
    return town.endswith(SEEN), conditions == SEEN
