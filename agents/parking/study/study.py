"""Study `parking`: rows 22 to 25 of the thesis's comparisons. The same command resumes trainings and judgements.

    python -m dohyo.agents.studies parking run --set runs=out/parking --arms dppo-il --trainings 0
    python -m dohyo.agents.studies parking run --set runs=out/parking train=false     # judge what is trained so far
    python -m dohyo.agents.studies parking table --rows out/studies/parking

A training is RUNS/ARM/seed-N, as `dohyo train parking` makes it. Its best policy by 256 other lots is judged.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Final

from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.learning.runs.trainer import train_to_the_end
from dohyo.agents.parking.study import tables
from dohyo.agents.parking.study.arms import ARMS, EXPERT
from dohyo.agents.parking.study.judging import judged
from dohyo.agents.parking.training.dppo_il import PARKING
from dohyo.agents.studies.arms import TRAININGS, Cell
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.study import Study
from dohyo.agents.studies.trained import TrainedOptions, columns, own_trainings, result_of

BLOCKS: Final = 20
"""Rows of each training and benchmark: 2,000 lots."""
THRESHOLD: Final = 90.0
"""Success on a training's held-out lots, %, whose steps are compared; fixed before the trainings."""


class Options(TrainedOptions):
    """Options of a run, see `TrainedOptions`."""

    runs: Path = Path("out/parking")


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
        train = partial(train_to_the_end, PARKING, "parking", ARMS[arm].config(seed))
        path = options.trained(f"{arm}/seed-{seed}", train)
        policy, trained = OnnxPolicy(path).of_batch, training_facts(path.parent)
    for cell in job:
        yield {**cell._asdict(), **trained, **judged(policy, cell.benchmark, int(cell.seed or 0))}


def training_facts(folder: Path) -> Row:
    """Steps of a training, whether it is finished, and steps to the threshold; None: it is not reached so far."""
    curve = columns(folder / "evaluations.csv")
    reached = curve["steps"][curve["success"] >= THRESHOLD]
    threshold = int(reached[0]) if len(reached) else None
    return {"steps": int(curve["steps"][-1]), **result_of(folder, "finished"), "threshold_steps": threshold}


STUDY = Study(
    summary="parking: PPO, SAC, MA-POCA and the parts of DPPO-IL",
    room=Path(__file__).parents[1],
    options=Options,
    cells=cells,
    work=work,
    tables={"arms": tables.arms_table, "claims": tables.claims},
    together=lambda cell: (cell.arm, cell.training_seed, cell.benchmark),
    trainings=own_trainings,
    fresh=True,
    judged=tables.judged,
)
