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

SIGMAS_M: Final = (0.1, 0.5)
"""Errors of a receiver with which the thesis's 96 % can be reached, and of one with which it cannot."""
SEEDS: Final = range(5)
VARIANTS: Final[Mapping[str, Cell]] = MappingProxyType(
    {
        "uncalibrated": Cell("none", "es-ekf", 10.0, 0.1),
        "calibrated": Cell("calibrated", "es-ekf", 10.0, 0.1),
        "low-pass": Cell("calibrated + low-pass", "es-ekf", 10.0, 0.1),
        "ekf": Cell("calibrated + low-pass", "ekf", 10.0, 0.1),
        "gate": Cell("calibrated + low-pass", "es-ekf", 10.0, 0.1, outliers="gate"),
        "robust": Cell("calibrated + low-pass", "es-ekf", 10.0, 0.1, outliers="robust"),
    }
)
"""What is compared; rate and error are those of an arm and a place. "gate" drives the agents, "robust" reads logs."""
MEASURES: Final = ("accuracy", "rmse", "p95", "max_drift", "nees")


def arm_of(variant: str, rate_hz: float) -> str:
    """Name of an arm."""
    return f"{variant}-{rate_hz:g}hz"


ARMS: Final[Mapping[str, tuple[str, float]]] = MappingProxyType(
    {arm_of(variant, rate): (variant, rate) for variant, rate in product(VARIANTS, RATES_HZ)}
)


def place_of(sigma_m: float, route: str, seed: int) -> Place:
    """Journeys of a seed on a route, with a receiver of an error."""
    return Place(f"sigma-{sigma_m:g}m", route, seed)


def _sigma_of(benchmark: str) -> float:
    """Error of the receiver of a place, m."""
    return float(benchmark.removeprefix("sigma-").removesuffix("m"))


class Options(Config):
    """The study has no options."""


def cells(options: Options) -> list[studies.Cell]:
    """Every arm on every journey."""
    places = [place_of(sigma, route, seed) for sigma, route, seed in product(SIGMAS_M, ROUTES, SEEDS)]
    return cells_of([Block([*ARMS], (None,), places)])


def work(options: Options, job: Job) -> Iterator[Row]:
    """Filters the journeys of a job; a filter that diverged has no error, and an accuracy of 0."""
    for cell in job:
        variant, rate = ARMS[cell.arm]
        receiver = VARIANTS[variant].with_receiver(rate, _sigma_of(cell.benchmark))
        found = run_cell(receiver, cell.scenario, cell.seed or 0)
        yield {**cell._asdict(), **{name: _finite(found[name]) for name in MEASURES}}


def _finite(value: float) -> float | None:
    """The value, or None if it is no number, which JSON does not know."""
    return round(value, 6) if math.isfinite(value) else None


def _claims_at(sigma_m: float) -> tuple[Claim, ...]:
    def claim(left: str, relation: str, right: str, measure: str = "accuracy", rate: float = 10.0) -> Claim:
        names = (one if one in ARMS else arm_of(one, rate) for one in (left, right))
        return Claim(next(names), relation, next(names), measure, f"sigma-{sigma_m:g}m")  # type: ignore[arg-type]

    return (
        *of_ablation(
            21,
            claim("calibrated", ">", "uncalibrated"),
            claim("low-pass", "<", "calibrated", "rmse"),
            claim("low-pass-10hz", ">", "low-pass-0.2hz"),
            claim("low-pass-0.2hz", ">", "low-pass-0.05hz"),
        ),
        *(claim("low-pass", "<", "ekf", "rmse", rate) for rate in (10.0, 0.2)),
        *(claim(one, "=", "low-pass", "rmse", rate) for one in ("gate", "robust") for rate in (10.0, 0.2)),
    )


CLAIMS: Final = tuple(claim for sigma in SIGMAS_M for claim in _claims_at(sigma))
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
        lines = [
            [variant, *(mean_of(there.get(arm, []), arm, "accuracy") for arm in _rates(variant))]
            for variant in VARIANTS
        ]  # fmt: skip
        heads = [f"within 0.5 m, %: sigma {_sigma_of(where):g} m", *(f"{rate:g} Hz" for rate in RATES_HZ)]
        parts.append(markdown(heads, lines))
    return "\n\n".join(parts)


def _rates(variant: str) -> list[str]:
    return [arm_of(variant, rate) for rate in RATES_HZ]


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
