"""Gap of generalisation: success where the policies learned, and in a town or conditions that they never saw."""

from __future__ import annotations

from typing import Final

from dohyo.agents.hierarchical.study.tables import is_lawful
from dohyo.agents.studies.rows import grouped
from dohyo.agents.studies.study import Results
from dohyo.agents.studies.tables import fixed
from dohyo.agents.studies.unseen import PLACES, gap, place_of
from dohyo.evaluation.report.style import markdown
from dohyo.evaluation.statistics import share_estimate

SHIPPED: Final = 0
"""Seed of the training that drove all cells."""
OUTCOMES: Final = {"success, %": lambda row: bool(row["success"]), "lawful success, %": is_lawful}


def gap_section(results: Results) -> str:
    """A row per arm and outcome, of the arms that drove NoCrash in both towns; "" without any.

    Missions of the two towns are different ones, so that the gap's interval resamples both sides independently.
    """
    rows = [row for row in results.kept if row["benchmark"] == "nocrash" and row["seed"] == 0]
    lines = []
    for arm, own in grouped((row for row in rows if row["training_seed"] in (None, SHIPPED)), "arm").items():
        groups = [[row for row in own if place_of(row["cell"]) == place] for place in PLACES.values()]
        if not all(groups):
            continue
        for head, outcome in OUTCOMES.items():
            outcomes = [[outcome(row) for row in group] for group in groups]
            shares = [fixed(share_estimate(some)) for some in outcomes]
            lines.append([arm, head, *shares, fixed(gap(outcomes[0], outcomes[-1]))])
    heads = ["arm", "NoCrash", *PLACES, "gap: both seen less both unseen"]
    return markdown(heads, lines) if lines else ""
