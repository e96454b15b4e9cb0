"""System: trains the arms of a study of endless driving, and drives their policies in the unseen town.

A training is RUNS/ARM/seed-N, as `dohyo train` makes it; its best policy by its own held-out missions drives. A row of
the benchmark "training" is the last evaluation of a training on those missions.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from dohyo.agents.endless_driving.study.arms import DrivingArm
from dohyo.agents.endless_driving.study.judging import measures
from dohyo.agents.endless_driving.study.tables import Claims, judged, tables_of
from dohyo.agents.learning.runs.trainer import Trainer, train_to_the_end
from dohyo.agents.registry import resolve
from dohyo.agents.studies.arms import Block, Cell, Place, cells_of
from dohyo.agents.studies.driving import driven
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.samples import Sample, scenario_of
from dohyo.agents.studies.study import Study
from dohyo.agents.studies.tables import PAGE
from dohyo.agents.studies.training_results import BENCHMARK as TRAINING
from dohyo.evaluation.agent import make_agent
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import SimulationError

SEEDS: Final = (0, 1, 2)
UNSEEN: Final = Sample("nocrash", ("town-test.empty.test", "town-test.regular.test", "town-test.dense.test"))
LAST: Final = ("return", "success", "completion", "lateral_m", "collision", "red_lights", "left_route", "blocked")
"""Columns of the last evaluation."""


class Options(Config):
    """Options of a run.

    Attributes:
        runs: Folder of all trainings.
        train: Whether trainings begin or resume; False: their policies are judged as they are.
    """

    runs: Path = Path("out")
    train: bool = True


@dataclass(frozen=True)
class System:
    """What a study trains and drives.

    Attributes:
        name: Of the trainer, and of the agent that drives with its policies.
        trainer: Of all arms.
        arms: By name.
    """

    name: str
    trainer: Trainer[Any]
    arms: Mapping[str, DrivingArm]

    def cells(self, options: Options) -> list[Cell]:
        """Every arm's trainings, and their drives of all missions."""
        own = [Place(TRAINING, "held-out missions", None)]
        return cells_of((Block((*self.arms,), SEEDS, own), Block((*self.arms,), SEEDS, UNSEEN.places())))

    def work(self, options: Options, job: Job) -> Iterator[Row]:
        """Trains the arm of a job, unless that is done; then its last evaluation, or its drives.

        Raises:
            RunStoppedError: The training was stopped.
            SimulationError: There is no policy yet and none may be trained, or a simulation failed.
        """
        folder = options.runs / job[0].arm / f"seed-{job[0].training_seed}"
        if options.train:
            config = self.arms[job[0].arm].training(self.trainer.config, job[0].training_seed or 0)
            train_to_the_end(self.trainer, self.name, config, folder)
        if not (folder / "best.onnx").exists():
            raise SimulationError(f"no policy in '{folder}' so far")
        facts = training_facts(folder)
        for cell in job:
            found = last(folder) if cell.benchmark == TRAINING else self._drive(cell, folder)
            yield {**cell._asdict(), **facts, **found}

    def _drive(self, cell: Cell, folder: Path) -> Row:
        agent = make_agent(resolve(self.name), {"policy": str(folder / "best.onnx")})
        return measures(*driven(scenario_of(cell), agent))

    def study(self, summary: str, room: Path, claims: Claims) -> Study[Options]:
        """The study, whose rows and page are in a system's folder."""
        work: Callable[[Options, Job], Iterator[Row]] = self.work
        return Study(
            summary=summary,
            stored=room / "results",
            page=room / PAGE,
            options=Options,
            cells=self.cells,
            work=work,
            tables=tables_of(self.arms, claims),
            together=_together,
            fresh=True,
            judged=partial(judged, claims),
        )


def _together(cell: Cell) -> tuple[str, int | None, str]:
    """Drives of one training in one amount of traffic are one job."""
    return cell.arm, cell.training_seed, cell.scenario.rpartition(".")[0]


def training_facts(folder: Path) -> Row:
    """Steps and updates of a training so far, and whether it is finished."""
    result = json.loads((folder / "result.json").read_text())
    return {name: result[name] for name in ("steps", "updates", "finished", "tier")}


def last(folder: Path) -> Row:
    """The last evaluation, the return's slope to it, per 10,000 steps, and the expert's share of the last round."""
    evaluations, rounds = _table(folder / "evaluations.csv"), _table(folder / "metrics.csv")
    found: Row = {name: float(evaluations[-1][name]) for name in LAST}
    slope = None
    if len(evaluations) > 1:
        (steps, value), (before, earlier) = ((float(row["steps"]), float(row["return"])) for row in evaluations[:-3:-1])
        slope = 1e4 * (value - earlier) / (steps - before)
    shares = [float(row["demonstrated_steps"]) for row in rounds if row.get("demonstrated_steps")]
    return found | {"slope": slope, "expert_share": shares[-1] if shares else None}


def _table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))
