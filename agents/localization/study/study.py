"""Study `localization`: calibration, low-pass, filter, rate of the fixes and treatment of outliers, paired by journey.

python -m dohyo.agents.studies localization run
python -m dohyo.agents.studies localization table --write

An arm is CALIBRATION-RATE, such as "low-pass-10hz": an ES-EKF without any treatment of outliers, unless it says so.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Final

from dohyo.agents.localization.settings import OutlierPolicy
from dohyo.agents.localization.study.grid import RATES_HZ, Cell, run_cell
from dohyo.agents.localization.study.synthetic import ROUTES
from dohyo.agents.studies import arms as studies
from dohyo.agents.studies.arms import Block, Place, cells_of
from dohyo.agents.studies.claims import Claim, of_ablation
from dohyo.agents.studies.rows import Row, by_arm, grouped
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.study import Results, Study, judging
from dohyo.agents.studies.tables import claims_section, fixed, mean_of
from dohyo.evaluation.report.style import markdown
from dohyo.sumo_networks.config import Config

SIGMAS_M: Final[Mapping[str, float]] = MappingProxyType({"sigma-0.1m": 0.1, "sigma-0.5m": 0.5})
"""Places: the error of a receiver with which the thesis's 96 % can be reached, and of one with which it cannot."""
SEEDS: Final = range(5)
VARIANTS: Final[Mapping[str, tuple[str, str, OutlierPolicy]]] = MappingProxyType(
    {
        "uncalibrated": ("none", "es-ekf", "none"),
        "calibrated": ("calibrated", "es-ekf", "none"),
        "low-pass": ("calibrated + low-pass", "es-ekf", "none"),
        "ekf": ("calibrated + low-pass", "ekf", "none"),
        "gate": ("calibrated + low-pass", "es-ekf", "gate"),
        "robust": ("calibrated + low-pass", "es-ekf", "robust"),
    }
)
"""Arm of the grid, filter and treatment of outliers. "gate" drives the agents, "robust" reads logs."""
MEASURES: Final = ("accuracy", "rmse", "p95", "max_drift", "nees")


def arm_of(variant: str, rate_hz: float) -> str:
    """Name of an arm."""
    return f"{variant}-{rate_hz:g}hz"


ARMS: Final[Mapping[str, tuple[str, float]]] = MappingProxyType(
    {arm_of(variant, rate): (variant, rate) for variant, rate in product(VARIANTS, RATES_HZ)}
)


class Options(Config):
    """The study has no options."""


def cells(options: Options) -> list[studies.Cell]:
    """Every arm on every journey."""
    places = [Place(*where) for where in product(SIGMAS_M, ROUTES, SEEDS)]
    return cells_of([Block([*ARMS], (None,), places)])


def work(options: Options, job: Job) -> Iterator[Row]:
    """Filters the journeys of a job; a filter that diverged has no error, and an accuracy of 0."""
    for cell in job:
        variant, rate = ARMS[cell.arm]
        arm, name, outliers = VARIANTS[variant]
        journey = Cell(arm, name, rate, SIGMAS_M[cell.benchmark], outliers=outliers)
        found = run_cell(journey, cell.scenario, cell.seed or 0)
        yield {**cell._asdict(), **{name: _finite(found[name]) for name in MEASURES}}


def _finite(value: float) -> float | None:
    """The value, or None if it is no number, which JSON does not know."""
    return round(value, 6) if math.isfinite(value) else None


def _claims_at(where: str) -> Iterator[Claim]:
    yield from of_ablation(
        21,
        Claim("calibrated-10hz", ">", "uncalibrated-10hz", "accuracy", where),
        Claim("low-pass-10hz", ">", "low-pass-0.2hz", "accuracy", where),
        Claim("low-pass-0.2hz", "=", "low-pass-0.05hz", "accuracy", where, "low-pass: 0.05 Hz is as good as 0.2 Hz"),
    )
    yield Claim("low-pass-10hz", "<", "calibrated-10hz", "rmse", where)
    for rate in (10.0, 0.2):
        own = arm_of("low-pass", rate)
        yield Claim(own, "<", arm_of("ekf", rate), "rmse", where)
        yield from (Claim(arm_of(one, rate), "=", own, "rmse", where) for one in ("gate", "robust"))


CLAIMS: Final = tuple(claim for where in SIGMAS_M for claim in _claims_at(where))
"""Those of row 21 are the thesis's, in which 92 and 90 % at 0.2 and 0.05 Hz count as equal; the others are ours."""
judged = judging(CLAIMS)
claims = claims_section(
    judged,
    ("claim", "where", "measure", "n"),
    lambda one: fixed(one.difference, 1 if one.claim.measure == "accuracy" else 4),
)


def shares_table(results: Results) -> str:
    """Share of samples within 0.5 m by variant and rate, for each error of the receiver."""
    parts = []
    for where, rows in grouped(results.kept, "benchmark").items():
        there = by_arm(rows, ARMS)
        lines = []
        for variant in VARIANTS:
            arms = [arm_of(variant, rate) for rate in RATES_HZ]
            lines.append([variant, *(mean_of(there.get(arm, ()), arm, "accuracy") for arm in arms)])
        heads = [f"within 0.5 m, %: sigma {SIGMAS_M[where]:g} m", *(f"{rate:g} Hz" for rate in RATES_HZ)]
        parts.append(markdown(heads, lines))
    return "\n\n".join(parts)


STUDY = Study(
    summary="calibration, low-pass, filters, rates and outliers on synthetic journeys",
    room=Path(__file__).parents[1],
    published="arms",
    options=Options,
    cells=cells,
    work=work,
    tables={"arms": shares_table, "claims": claims},
    together=lambda cell: (cell.benchmark, cell.arm),
    judged=judged,
)
