"""Study `gri`: rows 1 to 4 of the thesis's comparisons. The same command resumes trainings and judgements.

    python -m dohyo.agents.studies gri run --set runs=out/gri --arms pendulum-sac-p20 --trainings 0
    python -m dohyo.agents.studies gri table --rows out/studies/gri

A training is RUNS/ARM/seed-N, as `dohyo train gri` makes it. Its last policy is judged on episodes that no evaluation
of the training uses; the evaluations are the rows of its curve. An expert is RUNS/experts/PROBLEM, its demonstrations
are in RUNS/demonstrations.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import torch

from dohyo.agents.gri.study import tables
from dohyo.agents.gri.study.arms import ARMS, PROBLEMS, GriArm, expert_config
from dohyo.agents.gri.study.judging import JUDGED, judged
from dohyo.agents.gri.study.tables import CURVE, LAST, expert_of
from dohyo.agents.gri.training import GRI, GriRunConfig, record, task_of
from dohyo.agents.learning.experience.demonstrations import INDEX
from dohyo.agents.learning.gymnasium.task import GYMNASIUM
from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.learning.runs.trainer import train_to_the_end
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.study import Study
from dohyo.agents.studies.tables import PAGE
from dohyo.sumo_networks.config import Config

TRAININGS: Final = (0, 1, 2)


class Options(Config):
    """Options of a run.

    Attributes:
        runs: Folder of all trainings.
    """

    runs: Path = Path("out/gri")


def cells(options: Options) -> list[Cell]:
    """Each training's judged episodes, and the evaluations of its curve."""
    found = []
    for name, arm in ARMS.items():
        steps = evaluated_at(arm.config(0, Path()))
        for training in TRAININGS:
            found += [Cell(name, training, f"{arm.problem}, {LAST}", f"episode-{seed}", seed) for seed in JUDGED]
            found += [Cell(name, training, f"{arm.problem}, {CURVE}", f"step-{step}", step) for step in steps]
    for problem in PROBLEMS:
        found += [Cell(expert_of(problem), None, f"{problem}, {LAST}", f"episode-{seed}", seed) for seed in JUDGED]
    return found


def evaluated_at(config: GriRunConfig) -> list[int]:
    """Steps of a training's evaluations."""
    return list(range(0, config.steps + 1, config.evaluate_every))


def prepare(options: Options, wanted: Sequence[Cell], workers: int) -> None:
    """Trains the experts of the wanted arms, and records their demonstrations, where there are none."""
    for problem in dict.fromkeys(cell.benchmark.partition(",")[0] for cell in wanted):
        if PROBLEMS[problem].expert is None:
            continue
        train_to_the_end(GYMNASIUM, "gymnasium", expert_config(problem), options.runs / "experts" / problem)
    for arm in {cell.arm: ARMS[cell.arm] for cell in wanted if cell.arm in ARMS}.values():
        folder = shown_in(options.runs, arm)
        if not (folder / INDEX).exists():
            expert = options.runs / "experts" / arm.problem / "best.onnx"
            own = PROBLEMS[arm.problem].expert is None
            config = arm.config(0, folder).model_copy(update={"expert": "" if own else str(expert)})
            record(config, config.task, folder)


def shown_in(runs: Path, arm: GriArm) -> Path:
    """Folder of an arm's demonstrations."""
    return runs / "demonstrations" / arm.shown


def work(options: Options, job: Job) -> Iterator[Row]:
    """Trains the arm of a job, unless that is done, and judges its last policy; or judges an expert."""
    torch.set_num_threads(1)
    if job[0].arm not in ARMS:
        yield from _expert_rows(options, job)
        return
    arm, seed = ARMS[job[0].arm], job[0].training_seed or 0
    folder = options.runs / job[0].arm / f"seed-{seed}"
    config = arm.config(seed, shown_in(options.runs, arm))
    train_to_the_end(GRI, "gri", config, folder)
    ended = judged(task_of(config.env, JUDGED.start, len(JUDGED)), OnnxPolicy(folder / "policy.onnx"))
    with (folder / "evaluations.csv").open(newline="") as file:
        curve = {int(row["steps"]): Row({"return": float(row["return"])}) for row in csv.DictReader(file)}
    told = json.loads((folder / "result.json").read_text())
    facts = {"steps": told["steps"], "updates": told["updates"], "replay_demonstrated": _stored_share(folder)}
    for cell in job:
        measures = (curve if cell.benchmark.endswith(CURVE) else ended)[int(cell.seed or 0)]
        yield {**cell._asdict(), **facts, **measures}


def _expert_rows(options: Options, job: Job) -> Iterator[Row]:
    """Rows of the expert of a problem; a task's own has no steps."""
    problem = job[0].benchmark.partition(",")[0]
    own, steps, policy = PROBLEMS[problem].expert is None, 0, None
    if not own:
        policy = OnnxPolicy(options.runs / "experts" / problem / "best.onnx")
        steps = expert_config(problem).steps
    ended = judged(task_of(PROBLEMS[problem].env, JUDGED.start, len(JUDGED)), policy)
    for cell in job:
        yield {**cell._asdict(), "steps": steps, **ended[int(cell.seed or 0)]}


def _stored_share(folder: Path) -> float:
    """Share of the demonstrator in the replay, mean over the rounds of a training."""
    with (folder / "metrics.csv").open(newline="") as file:
        values = [float(row["replay_demonstrated"]) for row in csv.DictReader(file)]
    return sum(values) / len(values)


def _together(cell: Cell) -> tuple[str, int | None]:
    return cell.arm, cell.training_seed


STUDY = Study(
    summary="GRI: shares of demonstrations, bad ones, and algorithms, on control and driving",
    stored=Path(__file__).parents[1] / "results",
    page=Path(__file__).parents[1] / PAGE,
    options=Options,
    cells=cells,
    work=work,
    tables={"shares": tables.shares, "curves": tables.curves, "claims": tables.claims},
    together=_together,
    prepare=prepare,
    judged=tables.judged,
)
