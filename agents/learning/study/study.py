"""Study `peers`: our algorithms against stable-baselines3's, with equal steps, settings and held-out episodes.

    python -m dohyo.agents.studies peers run --only Pendulum-v1 CartPole-v1
    python -m dohyo.agents.studies peers table --rows out/studies/peers

Updates are counted per second of the core that a training took, with the environment's steps, so that other processes
disturb little.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import torch

from dohyo.agents.learning.gymnasium.task import GymnasiumTask
from dohyo.agents.learning.runs.evaluation import evaluate
from dohyo.agents.learning.study.arms import MATCHES
from dohyo.agents.learning.study.libraries import LIBRARIES
from dohyo.agents.studies.arms import Block, Cell, Place, cells_of
from dohyo.agents.studies.rows import Row, grouped
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.study import Results, Study
from dohyo.evaluation.report.style import markdown
from dohyo.sumo_networks.config import Config


class Options(Config):
    """Options of a run.

    Attributes:
        episodes: Held-out episodes of every policy.
    """

    episodes: int = 20


def cells(options: Options) -> list[Cell]:
    """Every algorithm of both libraries on its environments."""
    return cells_of(
        Block([f"{name}, {library}" for library in LIBRARIES], range(match.trainings), [Place(env, "held-out", None)])
        for (env, name), match in MATCHES.items()
    )


def work(options: Options, job: Job) -> Iterator[Row]:
    """Trains and judges."""
    torch.set_num_threads(1)
    for cell in job:
        algorithm, library = cell.arm.split(", ")
        match = MATCHES[cell.benchmark, algorithm]
        began = time.process_time()
        act, updates = LIBRARIES[library](match, cell.training_seed or 0)
        core_s = time.process_time() - began
        task = GymnasiumTask(match.env, options.episodes)
        with closing(task.make_environments(options.episodes, processes=False)) as environments:
            value = evaluate(task, environments, act).mean_return.mean
        measures = {"steps": match.steps, "return": value, "updates": updates, "core_s": round(core_s, 2)}
        yield cell._asdict() | measures


def table(results: Results) -> str:
    """Returns of the trainings, of which three give no interval, and updates per second of the core."""
    lines = []
    for env, there in sorted(grouped(results.kept, "benchmark").items()):
        for arm, mine in sorted(grouped(there, "arm").items()):
            returns = [float(row["return"]) for row in mine]
            value = f"{np.mean(returns):.1f} [{min(returns):.1f}, {max(returns):.1f}]"
            rate = sum(row["updates"] for row in mine) / sum(row["core_s"] for row in mine)
            algorithm, library = arm.split(", ")
            name = algorithm.upper() if library == "dohyo" else MATCHES[env, algorithm].peer
            lines.append([env, name, library, f"{mine[0]['steps']:,}", str(len(mine)), value, f"{rate:.0f}"])
    heads = ["environment", "algorithm", "library", "steps", "trainings", "return, mean [least, most]", "updates/s"]
    return markdown(heads, lines) if lines else ""


STUDY = Study(
    summary="our algorithms against stable-baselines3's on gymnasium's environments",
    room=Path(__file__).parents[1],
    published="peers",
    options=Options,
    cells=cells,
    work=work,
    tables={"peers": table},
)
