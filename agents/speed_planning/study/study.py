"""Study `dissipation`: plans for connected cars on the same mornings, paired.

python -m dohyo.agents.studies dissipation run --workers 2
python -m dohyo.agents.studies dissipation table --rows out/studies/dissipation
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from dohyo.agents.speed_planning.study.dissipation import Morning, SetPoints, buffer_policy, segment_speeds
from dohyo.agents.speed_planning.study.mornings import (
    ARMS,
    BENCHMARK,
    CHOSEN,
    FURTHER,
    SEEDS,
    drive_morning,
    lead_in_of,
    morning_place,
)
from dohyo.agents.speed_planning.study.tables import judged, tables
from dohyo.agents.studies.arms import Block, Cell, cells_of
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.study import Study
from dohyo.sumo_networks.config import Config

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
    """Every arm on ten mornings, and no plan and the chosen designs on forty further ones."""
    wanted = {FURTHER: ("none", *CHOSEN), BENCHMARK: tuple(ARMS)}
    return cells_of(
        Block([arm], (_training(arm),), [morning_place(seed, benchmark) for seed in SEEDS[benchmark]])
        for benchmark, arms in wanted.items()
        for arm in arms
    )


def _training(arm: str) -> int | None:
    """Seed of the shipped weights, which are one training, or None."""
    return 0 if ARMS[arm].learned else None


def check(options: Options, wanted: Sequence[Cell], workers: int) -> None:
    """Raises InvalidInputError if an arm needs a trained network that is missing, before anything is driven."""
    for arm in dict.fromkeys(cell.arm for cell in wanted):
        segment_speeds(ARMS[arm].forecast, options.forecaster)
        buffer_policy(ARMS[arm].design)


def work(options: Options, job: Job) -> Iterator[Row]:
    """Drives the arms of one morning."""
    return drive_morning(options.morning, options.forecaster, job)


STUDY = Study(
    summary="plans for connected cars on mornings of the freeway",
    room=Path(__file__).parents[1],
    published="mornings",
    options=Options,
    cells=cells,
    work=work,
    tables={"dissipation": tables},
    together=lead_in_of,
    prepare=check,
    fresh=True,
    judged=judged,
)
