"""Results of trainings, read from RUNS/ARM/seed-N/POLICY, and their means over seeds.

    runs/ghrl/seed-0/lane/{config.toml,metrics.csv,evaluations.csv}, runs/ghrl/seed-1/lane/..., runs/hrl/seed-0/...

An interval over seeds is Student's; a single seed has the interval of its own evaluation, over held-out episodes.
"""

from __future__ import annotations

import csv
import math
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from scipy.special import stdtrit  # type: ignore[import-untyped]

from dohyo.agents.hierarchical.arms import ARMS, POLICIES
from dohyo.evaluation.report.style import MISSING, interval
from dohyo.evaluation.statistics import Estimate
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError

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
Columns = Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True)
class TrainingRun:
    """One policy's training with one seed.

    Attributes:
        seed: Of the training.
        imitated: Steps before the first round, in which the rules were imitated.
        evaluations: (E,) by column of evaluations.csv, E at least 1; NaN for empty cells.
        rounds: (R,) by column of metrics.csv.
    """

    seed: int
    imitated: int
    evaluations: Columns
    rounds: Columns

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


Results = Mapping[str, Mapping[str, Sequence[TrainingRun]]]
"""Runs by seed, by policy and arm."""


def read_results(runs: Path) -> tuple[Results, list[Path]]:
    """Every run of a folder that has been evaluated, and the folders of those that have not been.

    Raises:
        InvalidInputError: There is no run, or one is damaged.
    """
    found: dict[str, dict[str, list[TrainingRun]]] = {}
    waiting = []
    for policy in POLICIES:
        for arm in _in_order(path.name for path in runs.iterdir()) if runs.is_dir() else ():
            for seed, folder in _seeds(runs / arm):
                if not (folder / policy).is_dir():
                    continue
                run = read_run(folder / policy, seed)
                if run is None:
                    waiting.append(folder / policy)
                else:
                    found.setdefault(policy, {}).setdefault(arm, []).append(run)
    if not found:
        raise InvalidInputError(
            f"'{runs}': expected evaluated runs as ARM/seed-N/POLICY, of policies {', '.join(POLICIES)}; found none"
        )
    return found, waiting


def only(results: Results, arms: Sequence[str]) -> Results:
    """Results of some arms; policies that none of them has are left out.

    Raises:
        InvalidInputError: There is no such arm.
    """
    there = {arm for trained in results.values() for arm in trained}
    if unknown := [arm for arm in arms if arm not in there]:
        raise InvalidInputError(f"expected arms of {', '.join(_in_order(there))}; got '{unknown[0]}'")
    kept = {policy: {arm: runs for arm, runs in trained.items() if arm in arms} for policy, trained in results.items()}
    return {policy: trained for policy, trained in kept.items() if trained}


def read_run(folder: Path, seed: int) -> TrainingRun | None:
    """Run of a folder; None before its first evaluation.

    Raises:
        InvalidInputError: The run is damaged.
    """
    try:
        config = tomllib.loads((folder / "config.toml").read_text())
        evaluations, rounds = (_columns(folder / f"{name}.csv") for name in ("evaluations", "metrics"))
    except (OSError, ValueError) as error:
        raise InvalidInputError(f"'{folder}' is no run: {error}") from error
    if not len(evaluations.get("steps", ())):
        return None
    if missing := {"return", "success"} - evaluations.keys():
        raise InvalidInputError(f"'{folder / 'evaluations.csv'}': expected columns {', '.join(sorted(missing))}")
    return TrainingRun(seed, int(config.get("ppo", {}).get("imitated_steps", 0)), evaluations, rounds)


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
    half = float(stdtrit(n - 1, 0.975)) * float(np.std(values, ddof=1)) / math.sqrt(n)
    least, most = BOUNDS.get(measure, (-math.inf, math.inf))
    return Estimate(mean, max(mean - half, least), min(mean + half, most), n)


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


def table(results: Results) -> str:
    """Markdown: a row per policy and arm. The best evaluation is chosen by the episodes that measure it.

    Infractions are the share of episodes that ended with one.
    """
    told = ("return, last", "success, last, %", "infractions, last", "return, best", "success then, %")
    heads = ("policy", "arm", "seeds", "steps", "of these imitating", *told)
    rows = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for policy, arms in results.items():
        for arm, runs in arms.items():
            last, best = [run.last for run in runs], [run.best for run in runs]
            cells = [
                policy,
                arm,
                ", ".join(str(run.seed) for run in runs),
                _range([int(run.last) for run in runs]),
                _range([run.imitated for run in runs]),
                *(_told(runs, name, last) for name in ("return", "success", "infraction")),
                *(_told(runs, name, best) for name in ("return", "success")),
            ]
            rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


def _told(runs: Sequence[TrainingRun], measure: str, steps: Sequence[float]) -> str:
    each = [run.held_out(measure, [at])[0] for run, at in zip(runs, steps, strict=True)]
    found = over_seeds(each, measure)
    return interval(found).rpartition(" n=")[0] or MISSING


def _range(counts: Sequence[int]) -> str:
    low, high = min(counts), max(counts)
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"


def _in_order(arms: Iterable[str]) -> list[str]:
    known = list(ARMS)
    return sorted(arms, key=lambda arm: (known.index(arm) if arm in known else len(known), arm))


def _seeds(arm: Path) -> list[tuple[int, Path]]:
    named = [(re.fullmatch(r"seed-(\d+)", path.name), path) for path in arm.glob("seed-*")]
    return sorted((int(match[1]), path) for match, path in named if match)


def _columns(path: Path) -> Columns:
    with path.open(newline="") as file:
        header, *rows = list(csv.reader(file)) or [[]]
    values = np.array([[float(cell) if cell else math.nan for cell in row] for row in rows])
    return dict(zip(header, values.reshape(len(rows), len(header)).T, strict=True))
