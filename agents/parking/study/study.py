"""Study `parking`: rows 22 to 25 of the thesis's comparisons. The same command resumes trainings and judgements.

    python -m dohyo.agents.studies parking run --set runs=out/parking --arms dppo-il --trainings 0
    python -m dohyo.agents.studies parking run --set runs=out/parking train=false     # judge what is trained so far
    python -m dohyo.agents.studies parking table --rows out/studies/parking

A training is RUNS/ARM/seed-N, as `dohyo train parking` makes it. Its best policy by 256 other lots is judged.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.learning.runs.trainer import train_to_the_end
from dohyo.agents.parking.study import tables
from dohyo.agents.parking.study.arms import ARMS, EXPERT
from dohyo.agents.parking.study.judging import judged
from dohyo.agents.parking.training.dppo_il import PARKING
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.study import Study
from dohyo.agents.studies.tables import PAGE
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import SimulationError

TRAININGS: Final = (0, 1, 2)
BLOCKS: Final = 20
"""Rows of each training and benchmark: 2,000 lots."""
THRESHOLD: Final = 90.0
"""Success on a training's held-out lots, %, whose steps are compared; fixed before the trainings."""


class Options(Config):
    """Options of a run.

    Attributes:
        runs: Folder of all trainings.
        train: Whether trainings begin or resume; False: they are judged as they are.
    """

    runs: Path = Path("out/parking")
    train: bool = True


def cells(options: Options) -> list[Cell]:
    """Every arm on its benchmarks; the expert has no training."""
    return [
        Cell(name, training, benchmark, f"block-{block}", block)
        for name, arm in ARMS.items()
        for training in ((None,) if name == EXPERT else TRAININGS)
        for benchmark in arm.benchmarks
        for block in range(BLOCKS)
    ]


def work(options: Options, job: Job) -> Iterator[Row]:
    """Trains the arm of a job, unless that is done, and judges its policy.

    Raises:
        RunStoppedError: The training was stopped.
        SimulationError: There is no policy yet, and none may be trained.
    """
    arm, seed = job[0].arm, job[0].training_seed
    policy, trained = None, Row()
    if seed is not None:
        folder = options.runs / arm / f"seed-{seed}"
        if options.train:
            train_to_the_end(PARKING, "parking", ARMS[arm].config(seed), folder)
        if not (folder / "best.onnx").exists():
            raise SimulationError(f"no policy in '{folder}' so far")
        policy, trained = OnnxPolicy(folder / "best.onnx").of_batch, training_facts(folder)
    for cell in job:
        yield {**cell._asdict(), **trained, **judged(policy, cell.benchmark, int(cell.seed or 0))}


def training_facts(folder: Path) -> Row:
    """Steps of a training, whether it is finished, and steps to the threshold; None: it is not reached so far."""
    with (folder / "evaluations.csv").open(newline="") as file:
        curve = [(int(row["steps"]), float(row["success"])) for row in csv.DictReader(file)]
    reached = next((steps for steps, success in curve if success >= THRESHOLD), None)
    finished = json.loads((folder / "result.json").read_text())["finished"]
    return {"steps": curve[-1][0], "finished": finished, "threshold_steps": reached}


def _together(cell: Cell) -> tuple[str, int | None, str]:
    return cell.arm, cell.training_seed, cell.benchmark


STUDY = Study(
    summary="parking: PPO, SAC, MA-POCA and the parts of DPPO-IL",
    stored=Path(__file__).parents[1] / "results",
    page=Path(__file__).parents[1] / PAGE,
    options=Options,
    cells=cells,
    work=work,
    tables={"arms": tables.arms_table, "claims": tables.claims},
    together=_together,
    fresh=True,
    judged=tables.judged,
)
