"""Localization beside the published edition: filters instead of agents, from the rows of their own study."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

from dohyo.agents.league.edition import AGENTS
from dohyo.agents.studies.tables import bracketed
from dohyo.evaluation.report.style import markdown
from dohyo.evaluation.statistics import Estimate

STUDY: Final = AGENTS / "localization" / "results" / "study.json"
FILTERS: Final = {"es-ekf": "ES-EKF (thesis C)", "ekf": "EKF", "ukf": "UKF"}
RATES_HZ: Final = (10.0, 1.0, 0.2, 0.05)
SIGMA_M: Final = 0.3
TOLD: Final = (
    "Share of a journey within 0.5 m of the truth, by the rate of fixes, whose error has a sigma of 0.3 m. "
    "Sensors are calibrated; n is the number of journeys. Filters meet no traffic, and so have no seeds of the league. "
    "The UKF drove fewer journeys, so that it compares with the others on its own ones alone (all cells). "
    "These journeys were made with dohyo 0.1.0."
)
_TITLE: Final = "## Where a vehicle is"
NOT_HERE: Final = "The stored rows of this section are in dohyo's repository only, not in an installed dohyo."


def section() -> str:
    """Filters by the rate of fixes, from the rows of their own study; a line that tells so where they are missing."""
    if not STUDY.exists():
        return f"{_TITLE}\n\n{NOT_HERE}"
    cells = json.loads(STUDY.read_text())["cells"]
    lines = [[told, *(_share(cells, name, rate) for rate in RATES_HZ)] for name, told in FILTERS.items()]
    table = markdown(["within 0.5 m, %", *(f"{rate:g} Hz" for rate in RATES_HZ)], lines)
    return f"{_TITLE}\n\n{TOLD}\n\n{table}\n\n[All cells](researchers/systems/localization-results.md)."


def _share(cells: list[Mapping[str, Any]], name: str, rate_hz: float) -> str:
    wanted = {"filter": name, "rate_hz": rate_hz, "sigma_m": SIGMA_M, "arm": "calibrated"}
    (found,) = [
        one
        for one in cells
        if all(one[key] == value for key, value in wanted.items())
        and one["correlated_share"] == 0.5
        and one["vibration"] == 0.0
    ]
    accuracy = Estimate(**found["accuracy"])
    return f"{bracketed(accuracy)} n={accuracy.n}"
