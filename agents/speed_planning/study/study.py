"""Study `dissipation`: thirteen plans for connected cars on the same mornings, paired.

python -m dohyo.agents.studies dissipation run --workers 2
python -m dohyo.agents.studies dissipation table --rows out/studies/dissipation
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final

from dohyo.agents.speed_planning.study.dissipation import DESIGNS, Morning, SetPoints, buffer_policy, segment_speeds
from dohyo.agents.speed_planning.study.mornings import ARMS, drive_morning, morning_place
from dohyo.agents.studies.arms import Block, Cell, cells_of
from dohyo.agents.studies.claims import Claim, Judgement, Relation, judge
from dohyo.agents.studies.rows import Row, arms_in, matched
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.study import Results, Study
from dohyo.agents.studies.tables import PAGE, fixed
from dohyo.evaluation.report.style import markdown
from dohyo.evaluation.statistics import mean_estimate
from dohyo.sumo_networks.config import Config

SHOWN: Final = {
    "throughput_vph": ("throughput, veh/h", 0),
    "speed_mps": ("speed, m/s", 2),
    "speed_std_mps": ("its deviation, m/s", 2),
    "speed_std_within_mps": ("within a minute, m/s", 2),
    "fuel_circles_g_km": ("fuel CIRCLES, g/km", 1),
    "fuel_sumo_g_km": ("fuel SUMO, g/km", 1),
    "least_headway_s": ("least headway, s", 2),
    "least_ttc_s": ("least TTC, s", 2),
    "collisions": ("collisions", 1),
}
"""Metrics of the tables: head and decimals."""
COMPARED: Final[dict[str, Relation]] = {
    "throughput_vph": ">", "speed_std_mps": "<", "speed_std_within_mps": "<", "fuel_circles_g_km": "<",
}  # fmt: skip
"""Metrics of the claims, and what a better arm has."""
BASE: Final = Morning()


class Options(Config):
    """Options of a run.

    Attributes:
        penetration: Share of connected vehicles.
        minutes: Of control and measurement.
        set_points: Source of the cruise control's set-points.
        kernel_m: Width of the forward kernel, m.
        headroom: Factor on the smoothed state.
        forecaster: Shipped name or file behind the forecast sa-lstm.
    """

    penetration: float = BASE.penetration
    minutes: float = BASE.duration_s / 60
    set_points: SetPoints = BASE.set_points
    kernel_m: float = BASE.planner.kernel_m
    headroom: float = BASE.planner.headroom
    forecaster: str = "sa-lstm"

    @property
    def morning(self) -> Morning:
        """Settings of the mornings."""
        planner = dataclasses.replace(BASE.planner, kernel_m=self.kernel_m, headroom=self.headroom)
        return dataclasses.replace(
            BASE, penetration=self.penetration, set_points=self.set_points, duration_s=60 * self.minutes,
            planner=planner,
        )  # fmt: skip


def cells(options: Options) -> list[Cell]:
    """Every arm on ten mornings."""
    return cells_of([Block([*ARMS], (None,), [morning_place(seed) for seed in range(10)])])


def check(options: Options, wanted: Sequence[Cell], workers: int) -> None:
    """Raises InvalidInputError if an arm needs a trained network that is missing, before anything is driven."""
    for arm in dict.fromkeys(cell.arm for cell in wanted):
        segment_speeds(ARMS[arm].forecast, options.forecaster)
        buffer_policy(ARMS[arm].design)


def work(options: Options, job: Job) -> Iterator[Row]:
    """Drives the arms of one morning."""
    return drive_morning(options.morning, options.forecaster, job)


AGAINST_NONE: Final = tuple((arm, "none") for arm in ARMS if arm != "none")
BETTER_FORECAST: Final = tuple(
    (f"{design}+{forecast}", f"{design}+persistence")
    for design in DESIGNS[1:]
    for forecast in ("sa-lstm", "oracle", "none")
)


def judged(results: Results) -> list[Judgement]:
    """Every arm against none, and the effect of another forecast; all claims are judged together."""
    return judge(
        [
            Claim(arm, relation, other, metric, ablation=13)
            for arm, other in (*AGAINST_NONE, *BETTER_FORECAST)
            for metric, relation in COMPARED.items()
        ],
        lambda claim, arm: matched(results.rows, arm, claim.measure),
    )


def tables(results: Results) -> str:
    """Every arm, every arm against none, and the effect of another forecast."""
    rows, arms = results.rows, arms_in(results.rows, [*ARMS])
    found = {(one.claim.left, one.claim.right, one.claim.measure): one for one in judged(results)}
    return "\n".join(
        (
            markdown(["arm", "n", *(head for head, _ in SHOWN.values())], [_means(rows, arm) for arm in arms]),
            "\nAgainst `none`, same seeds, %:\n",
            _differences(rows, found, AGAINST_NONE),
            "\nAnother forecast against persistence, same seeds, %:\n",
            _differences(rows, found, BETTER_FORECAST),
        )
    )


def _means(rows: Sequence[Row], arm: str) -> list[str]:
    found = {metric: mean_estimate(_values(rows, arm, metric)) for metric in SHOWN}
    return [arm, str(found["speed_mps"].n), *(fixed(found[metric], digits) for metric, (_, digits) in SHOWN.items())]


def _differences(
    rows: Sequence[Row], found: dict[tuple[str, str, str], Judgement], pairs: Iterable[tuple[str, str]]
) -> str:
    lines = []
    for arm, other in pairs:
        verdicts = [found.get((arm, other, metric)) for metric in COMPARED]
        cells = [_percent(rows, one) for one in verdicts if one is not None]
        if cells and verdicts[0] is not None:
            lines.append([arm, other, str(verdicts[0].difference.n), *cells])
    return markdown(["arm", "against", "n", *(SHOWN[metric][0].partition(",")[0] for metric in COMPARED)], lines)


def _percent(rows: Sequence[Row], one: Judgement) -> str:
    """A difference as a share of the other arm's mean on the same seeds, %, with its interval and side."""
    mine, other = (matched(rows, arm, one.claim.measure) for arm in (one.claim.left, one.claim.right))
    base = [by[None] for key, by in other.items() if key in mine]
    scale, difference = 100.0 * len(base) / sum(base), one.difference
    if difference.mean is None or difference.low is None or difference.high is None:
        return ""
    mean, low, high = (scale * value for value in (difference.mean, difference.low, difference.high))
    side = "=" if one.verdict == "not resolved" else "<" if mean < 0.0 else ">"
    return f"{mean:+.1f} [{low:+.1f}, {high:+.1f}] {side}"


def _values(rows: Sequence[Row], arm: str, metric: str) -> list[float]:
    return [value for by_training in matched(rows, arm, metric).values() for value in by_training.values()]


STUDY = Study(
    summary="plans for connected cars on ten mornings of the freeway",
    stored=Path(__file__).parents[1].joinpath("results") / "mornings",
    page=Path(__file__).parents[1].joinpath(PAGE),
    options=Options,
    cells=cells,
    work=work,
    tables={"dissipation": tables},
    together=lambda cell: cell.seed,
    prepare=check,
    fresh=True,
    judged=judged,
)
