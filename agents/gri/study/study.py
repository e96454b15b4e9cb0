"""Study `gri`: rows 1 to 4 of the thesis's comparisons. The same command resumes trainings and judgements.

    python -m dohyo.agents.studies gri run --set runs=out/gri --arms pendulum-sac-p20 --trainings 0
    python -m dohyo.agents.studies gri run --set runs=out/gri train=false     # judge what is trained so far
    python -m dohyo.agents.studies gri table --rows out/studies/gri

A training is RUNS/ARM/seed-N, as `dohyo train gri` makes it. Its last policy is judged on episodes that no evaluation
of the training uses; the evaluations are the rows of its curve.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import torch

from dohyo.agents.gri.study import tables
from dohyo.agents.gri.study.arms import ARMS, PROBLEMS, expert_config
from dohyo.agents.gri.study.experts import expert, prepare, problem_of, shown_in
from dohyo.agents.gri.study.judging import JUDGED, judged
from dohyo.agents.gri.study.tables import CURVE, LAST, expert_of
from dohyo.agents.gri.training import GRI, GriRunConfig, task_of
from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.learning.runs.trainer import train_to_the_end
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.study import Study
from dohyo.agents.studies.trained import TrainedOptions, columns, result_of


class Options(TrainedOptions):
    """Options of a run, see `TrainedOptions`."""

    runs: Path = Path("out/gri")


def cells(options: Options) -> list[Cell]:
    """Each training's judged episodes, and the evaluations of its curve."""
    found = []
    for name, arm in ARMS.items():
        steps = evaluated_at(arm.config(0, Path()))
        for training in PROBLEMS[arm.problem].trainings:
            found += [Cell(name, training, f"{arm.problem}, {LAST}", f"episode-{seed}", seed) for seed in JUDGED]
            found += [Cell(name, training, f"{arm.problem}, {CURVE}", f"step-{step}", step) for step in steps]
    for problem in PROBLEMS:
        found += [Cell(expert_of(problem), None, f"{problem}, {LAST}", f"episode-{seed}", seed) for seed in JUDGED]
    return found


def evaluated_at(config: GriRunConfig) -> list[int]:
    """Steps of a training's evaluations."""
    return list(range(0, config.steps + 1, config.evaluate_every))


def work(options: Options, job: Job) -> Iterator[Row]:
    """Trains the arm of a job, unless that is done, and judges its last policy; or judges an expert.

    Raises:
        RunStoppedError: The training was stopped.
        SimulationError: There is no policy so far.
    """
    torch.set_num_threads(1)
    if job[0].arm not in ARMS:
        yield from _expert_rows(options, job)
        return
    config, policy = config_of(options, job[0]), policy_of(options, job[0])
    ended = judged(task_of(config.env, JUDGED.start, len(JUDGED)), OnnxPolicy(policy))
    curve, rounds = (columns(policy.with_name(f"{name}.csv")) for name in ("evaluations", "metrics"))
    returns = list(zip(curve["steps"].tolist(), curve["return"].tolist(), strict=True))
    stored = rounds["replay_demonstrated"].tolist()
    facts = {**result_of(policy.parent, "steps", "updates"), "replay_demonstrated": sum(stored) / len(stored)}
    for cell in job:
        at = int(cell.seed or 0)
        # A round in which a simulation was lost has fewer steps, and the next evaluation comes some steps late.
        measures = {"return": _first_from(at, returns)} if cell.benchmark.endswith(CURVE) else ended[at]
        yield {**cell._asdict(), **facts, **measures}


def config_of(options: Options, cell: Cell) -> GriRunConfig:
    """Settings of the training of a cell."""
    arm = ARMS[cell.arm]
    return arm.config(cell.training_seed or 0, shown_in(options.runs, arm))


def policy_of(options: Options, cell: Cell) -> Path:
    """Last policy of the training of a cell, which is trained unless that is done.

    Raises:
        RunStoppedError: The training was stopped.
        SimulationError: There is no policy so far.
    """
    train = partial(train_to_the_end, GRI, "gri", config_of(options, cell))
    return options.trained(f"{cell.arm}/seed-{cell.training_seed}", train, "policy.onnx")


def _first_from(step: int, returns: Sequence[tuple[float, float]]) -> float:
    """Return of the first evaluation at or after a step, else of the last one."""
    return next((value for at, value in returns if at >= step), returns[-1][1])


def _expert_rows(options: Options, job: Job) -> Iterator[Row]:
    """Rows of the expert of a problem; a task's own has no steps."""
    problem = problem_of(job[0])
    path = expert(options, problem)
    policy, steps = (None, 0) if path is None else (OnnxPolicy(path), expert_config(problem).steps)
    ended = judged(task_of(PROBLEMS[problem].env, JUDGED.start, len(JUDGED)), policy)
    for cell in job:
        yield {**cell._asdict(), "steps": steps, **ended[int(cell.seed or 0)]}


STUDY = Study(
    summary="GRI: shares of demonstrations, bad ones, and algorithms, on control and driving",
    room=Path(__file__).parents[1],
    options=Options,
    cells=cells,
    work=work,
    tables={"shares": tables.shares, "curves": tables.curves, "claims": tables.claims},
    together=lambda cell: (cell.arm, cell.training_seed),
    prepare=prepare,
    judged=tables.judged,
)
