"""Experts of the study: their trainings in RUNS/experts/PROBLEM, and what they show in RUNS/demonstrations."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from dohyo.agents.gri.study.arms import ARMS, PROBLEMS, GriArm, expert_config
from dohyo.agents.gri.training import record
from dohyo.agents.learning.experience.demonstrations import INDEX
from dohyo.agents.learning.gymnasium.task import GYMNASIUM
from dohyo.agents.learning.runs.trainer import train_to_the_end
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.trained import TrainedOptions


def prepare(options: TrainedOptions, wanted: Sequence[Cell], workers: int) -> None:
    """Trains the experts of the wanted arms, and records their demonstrations, where there are none."""
    if not options.train:
        return
    experts = {problem: expert(options, problem) for problem in dict.fromkeys(map(problem_of, wanted))}
    for arm in {cell.arm: ARMS[cell.arm] for cell in wanted if cell.arm in ARMS}.values():
        folder = shown_in(options.runs, arm)
        if not (folder / INDEX).exists():
            shows = experts[arm.problem]
            config = arm.config(0, folder).model_copy(update={"expert": "" if shows is None else str(shows)})
            record(config, config.task, folder)


def expert(options: TrainedOptions, problem: str) -> Path | None:
    """Policy of the expert of a problem, which is trained unless that is done; None: the task has its own.

    Raises:
        RunStoppedError: The training was stopped.
        SimulationError: There is no policy so far.
    """
    if PROBLEMS[problem].expert is None:
        return None
    train = partial(train_to_the_end, GYMNASIUM, "gymnasium", expert_config(problem))
    return options.trained(f"experts/{problem}", train)


def problem_of(cell: Cell) -> str:
    """Name of the problem of a cell, which is that of its arm, or of which it is an expert."""
    return ARMS[cell.arm].problem if cell.arm in ARMS else cell.benchmark.partition(",")[0]


def shown_in(runs: Path, arm: GriArm) -> Path:
    """Folder of an arm's demonstrations."""
    return runs / "demonstrations" / arm.shown
