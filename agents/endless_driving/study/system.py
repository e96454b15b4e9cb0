"""System: trains the arms of a study of endless driving, and drives their policies in the unseen town.

A training is RUNS/ARM/seed-N, as `dohyo train` makes it; its best policy by its own held-out missions drives. A row of
the benchmark "training" is the last evaluation of a training on those missions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from dohyo.agents.endless_driving.study.arms import DrivingArm
from dohyo.agents.endless_driving.study.judging import measures
from dohyo.agents.endless_driving.study.tables import Claims, judged, tables_of
from dohyo.agents.learning.runs.trainer import Trainer, train_to_the_end
from dohyo.agents.registry import resolve
from dohyo.agents.studies.arms import TRAININGS, Block, Cell, Place, cells_of
from dohyo.agents.studies.driving import driven
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.samples import Sample, scenario_of
from dohyo.agents.studies.study import Study
from dohyo.agents.studies.trained import TrainedOptions, columns, result_of
from dohyo.agents.studies.training_results import BENCHMARK as TRAINING
from dohyo.evaluation.agent import make_agent
from dohyo.sumo_networks.arrays import FloatArray

UNSEEN: Final = Sample("nocrash", ("town-test.empty.test", "town-test.regular.test", "town-test.dense.test"))
LAST: Final = ("return", "success", "completion", "lateral_m", "collision", "red_lights", "left_route", "blocked")
"""Columns of the last evaluation."""


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

    def cells(self, options: TrainedOptions) -> list[Cell]:
        """Every arm's trainings, and their drives of all missions."""
        own = [Place(TRAINING, "held-out missions", None)]
        return cells_of(Block([*self.arms], TRAININGS, places) for places in (own, UNSEEN.places()))

    def work(self, options: TrainedOptions, job: Job) -> Iterator[Row]:
        """Trains the arm of a job, unless that is done; then its last evaluation, or its drives.

        Raises:
            RunStoppedError: The training was stopped.
            SimulationError: There is no policy yet and none may be trained, or a simulation failed.
        """
        arm, seed = job[0].arm, job[0].training_seed or 0
        config = self.arms[arm].training(self.trainer.config, seed)
        policy = options.trained(f"{arm}/seed-{seed}", partial(train_to_the_end, self.trainer, self.name, config))
        facts = result_of(policy.parent, "steps", "updates", "finished", "tier")
        for cell in job:
            found = last(policy.parent) if cell.benchmark == TRAINING else self._drive(cell, policy)
            yield {**cell._asdict(), **facts, **found}

    def _drive(self, cell: Cell, policy: Path) -> Row:
        return measures(*driven(scenario_of(cell), make_agent(resolve(self.name), {"policy": str(policy)})))

    def study(self, summary: str, room: Path, claims: Claims) -> Study[TrainedOptions]:
        """The study, whose rows and page are in a system's folder.

        Drives of one training in one amount of traffic are one job.
        """
        work: Callable[[TrainedOptions, Job], Iterator[Row]] = self.work
        return Study(
            summary=summary,
            room=room,
            options=TrainedOptions,
            cells=self.cells,
            work=work,
            tables=tables_of(self.arms, claims),
            together=lambda cell: (cell.arm, cell.training_seed, cell.scenario.rpartition(".")[0]),
            fresh=True,
            judged=partial(judged, claims),
        )


def last(folder: Path) -> Row:
    """The last evaluation, the return's slope to it, per 10,000 steps, and the expert's share of the last round."""
    evaluations, rounds = columns(folder / "evaluations.csv"), columns(folder / "metrics.csv")
    found: Row = {name: evaluations[name][-1].item() for name in LAST}
    slopes = 1e4 * np.diff(evaluations["return"]) / np.diff(evaluations["steps"])
    shares = rounds.get("demonstrated_steps", np.empty(0))
    return found | {"slope": _end(slopes), "expert_share": _end(shares[np.isfinite(shares)])}


def _end(values: FloatArray) -> float | None:
    return values[-1].item() if len(values) else None
