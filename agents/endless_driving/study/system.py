"""System: trains the arms of a study of endless driving, and drives their policies in the unseen town.

A training is RUNS/ARM/seed-N, as `dohyo train` makes it; its best policy by its own held-out missions drives. A row of
the benchmark "training" is the last evaluation of a training on those missions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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
from dohyo.agents.studies.runner import Job, row_each
from dohyo.agents.studies.samples import Sample, scenario_of
from dohyo.agents.studies.study import Study
from dohyo.agents.studies.trained import TrainedOptions, columns, own_trainings, result_of
from dohyo.agents.studies.training_results import BENCHMARK as TRAINING
from dohyo.evaluation.agent import make_agent
from dohyo.sumo_networks.arrays import FloatArray

UNSEEN: Final = Sample("nocrash", ("town-test.empty.test", "town-test.regular.test", "town-test.dense.test"))
LAST: Final = ("return", "success", "completion", "lateral_m", "collision", "red_lights", "left_route", "blocked")
"""Columns of the last evaluation."""


def study_of(
    summary: str,
    room: Path,
    name: str,
    trainer: Trainer[Any],
    arms: Mapping[str, DrivingArm],
    claims: Claims,
) -> Study[TrainedOptions]:
    """Study of a system; drives of one training in one amount of traffic are one job.

    Args:
        summary: See `Study`.
        room: See `Study`.
        name: Of the trainer, and of the agent that drives with its policies.
        trainer: Of all arms.
        arms: By name.
        claims: The thesis's order of the arms.
    """
    own = [Place(TRAINING, "held-out missions", None)]
    return Study(
        summary=summary,
        room=room,
        options=TrainedOptions,
        cells=lambda options: cells_of(Block([*arms], TRAININGS, places) for places in (own, UNSEEN.places())),
        work=partial(work, name, trainer, dict(arms)),
        tables=tables_of(arms, claims),
        together=lambda cell: (cell.arm, cell.training_seed, cell.scenario.rpartition(".")[0]),
        trainings=own_trainings,
        fresh=True,
        judged=judged(claims),
    )


def work(
    name: str, trainer: Trainer[Any], arms: Mapping[str, DrivingArm], options: TrainedOptions, job: Job
) -> Iterator[Row]:
    """Trains the arm of a job, unless that is done; then its last evaluation, or its drives.

    Raises:
        RunStoppedError: The training was stopped.
        SimulationError: There is no policy yet and none may be trained. A drive that fails is a lost row.
    """
    arm, seed = job[0].arm, job[0].training_seed or 0
    config = arms[arm].training(trainer.config, seed)
    policy = options.trained(f"{arm}/seed-{seed}", partial(train_to_the_end, trainer, name, config))
    facts = result_of(policy.parent, "steps", "updates", "finished", "tier")

    def measured(cell: Cell) -> Row:
        if cell.benchmark == TRAINING:
            found = last(policy.parent)
        else:
            found = measures(*driven(scenario_of(cell), make_agent(resolve(name), {"policy": str(policy)})))
        return {**cell._asdict(), **facts, **found}

    yield from row_each(job, measured)


def last(folder: Path) -> Row:
    """The last evaluation, the return's slope to it, per 10,000 steps, and the expert's share of the last round."""
    evaluations, rounds = columns(folder / "evaluations.csv"), columns(folder / "metrics.csv")
    found: Row = {name: evaluations[name][-1].item() for name in LAST}
    slopes = 1e4 * np.diff(evaluations["return"]) / np.diff(evaluations["steps"])
    shares = rounds.get("demonstrated_steps", np.empty(0))
    return found | {"slope": _end(slopes), "expert_share": _end(shares[np.isfinite(shares)])}


def _end(values: FloatArray) -> float | None:
    return values[-1].item() if len(values) else None
