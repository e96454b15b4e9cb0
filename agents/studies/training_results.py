"""Results of trainings, read from RUNS/ARM/seed-N/TASK, and their means over seeds.

    runs/ghrl/seed-0/lane/{config.toml,evaluations.csv}, runs/ghrl/seed-1/lane/..., runs/hrl/seed-0/...

An interval over seeds is Student's; a single seed has the interval of its own evaluation, over held-out episodes.
"""

from __future__ import annotations

import json
import logging
import math
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.study import FIRST, Results
from dohyo.agents.studies.trained import Columns, columns
from dohyo.evaluation.report.style import MISSING, interval, markdown
from dohyo.evaluation.statistics import Estimate, student_estimate
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError

logger = logging.getLogger(__name__)

BENCHMARK = "training"
"""Benchmark of the rows of trainings; their scenario is the task."""
MEASURES: Mapping[str, str] = MappingProxyType(
    {
        "return": "return",
        "success": "success, %",
        "distance_m": "distance, m",
        "deviation_m": "deviation, m",
        "angle_rad": "angle, rad",
        "speed_m_s": "speed, m/s",
        "infraction": "infractions, share of episodes",
        "standing": "ended standing, share of episodes",
    }
)
"""Columns of evaluations.csv, and their axis titles."""
BOUNDS = MappingProxyType({"success": (0.0, 100.0), "infraction": (0.0, 1.0), "standing": (0.0, 1.0)})


@dataclass(frozen=True, slots=True)
class TrainingRun:
    """Training of one task with one seed.

    Attributes:
        seed: Of the training.
        imitated: Steps before the first round, in which the rules were imitated.
        evaluations: (E,) by column of evaluations.csv, E at least 1; NaN for empty cells.
    """

    seed: int
    imitated: int
    evaluations: Columns

    def held_out(self, measure: str, steps: Sequence[float]) -> list[Estimate]:
        """Measure at some steps, with its interval over episodes if it has one; linear between evaluations.

        Raises:
            InvalidInputError: The run does not have that measure.
        """
        if measure not in self.evaluations:
            raise InvalidInputError(
                f"expected evaluations with a column '{measure}', got {', '.join(self.evaluations)}"
            )
        nowhere = np.full(len(self.evaluations["steps"]), math.nan)
        columns = [self.evaluations.get(name, nowhere) for name in (measure, f"{measure}_low", f"{measure}_high")]
        values = [np.interp(steps, self.evaluations["steps"], column).tolist() for column in columns]
        known = [[None if math.isnan(value) else value for value in column] for column in values]
        return [Estimate(mean, low, high, 1) for mean, low, high in zip(*known, strict=True)]

    @property
    def last(self) -> float:
        """Steps of the last evaluation."""
        return float(self.evaluations["steps"][-1])

    @property
    def best(self) -> float:
        """Steps of the evaluation with the highest return, whose policy is kept."""
        return float(self.evaluations["steps"][np.argmax(self.evaluations["return"])])


Trainings = Mapping[str, Mapping[str, Sequence[TrainingRun]]]
"""Runs by seed, by task and arm."""


def run_folder(runs: Path, arm: str, seed: int, task: str) -> Path:
    """Folder of a training: RUNS/ARM/seed-N/TASK."""
    return runs / arm / f"seed-{seed}" / task


def find_trainings(runs: Path, tasks: Iterable[str]) -> Results:
    """A row for every training of a folder, with its folder; the facts have the sessions that they noted."""
    found: list[Row] = []
    sessions: list[dict[str, Any]] = []
    for folder in sorted(runs.glob("*/seed-*/*")):
        arm, numbered, task = folder.parts[-3:]
        seed = re.fullmatch(r"seed-(\d+)", numbered)
        if seed and task in tasks and folder.is_dir():
            found.append({**Cell(arm, int(seed[1]), BENCHMARK, task, None)._asdict(), "folder": str(folder)})
            sessions += _sessions(folder)
    return Results(found, {"sessions": sessions})


def _sessions(folder: Path) -> list[dict[str, Any]]:
    """Sessions of a run; where a folder keeps only its tables, one of the version that made such folders."""
    noted = folder / "run.json"
    return json.loads(noted.read_text())["sessions"] if noted.exists() else [{"versions": {"dohyo": FIRST}}]


def read_trainings(results: Results, arms: Sequence[str], tasks: Sequence[str]) -> Trainings:
    """Evaluated trainings of some arms, in a given order.

    Raises:
        InvalidInputError: There is none, or one is damaged.
    """
    found: dict[str, dict[str, list[TrainingRun]]] = {}
    for task in tasks:
        for arm in arms:
            rows = [row for row in results.rows if (row["arm"], row["scenario"]) == (arm, task) and "folder" in row]
            for row in sorted(rows, key=lambda row: int(row["training_seed"])):
                run = read_run(Path(row["folder"]), row["training_seed"])
                if run is None:
                    logger.warning("not evaluated so far: %s", row["folder"])
                else:
                    found.setdefault(task, {}).setdefault(arm, []).append(run)
    if not found:
        raise InvalidInputError(f"expected evaluated trainings of {', '.join(arms)}; found none")
    return found


def read_run(folder: Path, seed: int) -> TrainingRun | None:
    """Run of a folder; None before its first evaluation.

    Raises:
        InvalidInputError: The run is damaged.
    """
    try:
        config = tomllib.loads((folder / "config.toml").read_text())
        evaluations = columns(folder / "evaluations.csv")
    except (OSError, ValueError) as error:
        raise InvalidInputError(f"'{folder}' is no run: {error}") from error
    if not len(evaluations.get("steps", ())):
        return None
    if missing := {"return", "success"} - evaluations.keys():
        raise InvalidInputError(f"'{folder / 'evaluations.csv'}': expected columns {', '.join(sorted(missing))}")
    return TrainingRun(seed, int(config.get("ppo", {}).get("imitated_steps", 0)), evaluations)


def over_seeds(seeds: Sequence[Estimate], measure: str) -> Estimate:
    """The mean of one estimate per seed, with Student's 95 % interval, clipped to the measure's bounds.

    One seed, or equal seeds, have the widest interval over episodes instead.
    """
    values, n = [one.mean for one in seeds if one.mean is not None], len(seeds)
    if len(values) < n:
        return Estimate(None, None, None, n)
    mean = math.fsum(values) / n
    if min(values) == max(values):
        ends = [(one.low, one.high) for one in seeds if one.low is not None and one.high is not None]
        low, high = (min(low for low, _ in ends), max(high for _, high in ends)) if ends else (None, None)
        return Estimate(mean, low, high, n)
    least, most = BOUNDS.get(measure, (-math.inf, math.inf))
    found = student_estimate(values)
    low, high = (None if end is None else min(max(end, least), most) for end in (found.low, found.high))
    return Estimate(mean, low, high, n)


def course(runs: Sequence[TrainingRun], measure: str) -> tuple[FloatArray, list[Estimate]]:
    """Course of a measure on held-out episodes.

    Args:
        runs: Of one arm.
        measure: Of `MEASURES`.

    Returns:
        (G,) steps of all evaluations, up to the last common one, and the mean over seeds at each.

    Raises:
        InvalidInputError: A run does not have that measure.
    """
    each = [run.evaluations["steps"] for run in runs]
    first, last = max(steps[0] for steps in each), min(steps[-1] for steps in each)
    grid = np.unique(np.concatenate(each))
    grid = grid[(first <= grid) & (grid <= last)]
    values = zip(*(run.held_out(measure, grid.tolist()) for run in runs), strict=True)
    return grid, [over_seeds(at_step, measure) for at_step in values]


def table(trainings: Trainings) -> str:
    """Markdown: a row per task and arm. The best evaluation is chosen by the episodes that measure it.

    Infractions are the share of episodes that ended with one.
    """
    told = ("return, last", "success, last, %", "infractions, last", "return, best", "success then, %")
    rows = []
    for task, arms in trainings.items():
        for arm, runs in arms.items():
            last, best = [run.last for run in runs], [run.best for run in runs]
            rows.append(
                [
                    task,
                    arm,
                    ", ".join(str(run.seed) for run in runs),
                    _range([int(run.last) for run in runs]),
                    _range([run.imitated for run in runs]),
                    *(_told(runs, name, last) for name in ("return", "success", "infraction")),
                    *(_told(runs, name, best) for name in ("return", "success")),
                ]
            )
    return markdown(["policy", "arm", "seeds", "steps", "of these imitating", *told], rows)


def _told(runs: Sequence[TrainingRun], measure: str, steps: Sequence[float]) -> str:
    each = [run.held_out(measure, [at])[0] for run, at in zip(runs, steps, strict=True)]
    found = over_seeds(each, measure)
    return interval(found).rpartition(" n=")[0] or MISSING


def _range(counts: Sequence[int]) -> str:
    low, high = min(counts), max(counts)
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"
