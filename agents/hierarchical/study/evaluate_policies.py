"""Study `ghrl-policies`: the best policy of each training on many held-out exercises, the same for all arms.

    python -m dohyo.agents.studies ghrl-policies run --set runs=runs/study --workers 2
    python -m dohyo.agents.studies ghrl-policies table --write

A training chooses its best policy by thirty exercises, too few to compare arms. Here that policy drives others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import torch

from dohyo.agents.hierarchical.hierarchy import read_sub_policies
from dohyo.agents.hierarchical.study import held_out_tables
from dohyo.agents.hierarchical.study.arms import Options
from dohyo.agents.hierarchical.training.tasks import ManoeuvreTask
from dohyo.agents.learning.runs.evaluation import evaluate
from dohyo.agents.learning.tasks.task import SINGLE
from dohyo.agents.studies.arms import TRAININGS, Block, Cell, Place, cells_of
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.study import Study
from dohyo.agents.studies.training_results import run_folder
from dohyo.sumo_networks.seeds import HELD_OUT_FROM

FIRST = HELD_OUT_FROM + 1000
"""First seed: a training uses at most the thousand seeds before for its own evaluations."""


def exercises(policy: str, count: int) -> list[Place]:
    """Held-out exercises of a sub-policy."""
    return [Place(policy, "held-out", FIRST + number) for number in range(count)]


def cells(options: Options) -> list[Cell]:
    """Every cell of the published tables."""
    lights, lane, braking = exercises("lights", 200), exercises("lane", 100), exercises("braking", 100)
    blocks = (
        Block(("hrl", "p-5", "p-10", "p-20", "p-10-sum", "ghrl"), TRAININGS, lights),
        Block(("ghrl-pictures",), (0,), lights),
        Block(("hrl", "p-20"), TRAININGS, lane),
        Block(("p-5", "p-10"), (0,), lane),
        Block(("hrl", "p-5", "p-10", "p-20", "p-10-sum", "ghrl", "ghrl-pictures"), (0,), braking),
    )
    return cells_of(blocks)


@dataclass(frozen=True)
class Exercises(ManoeuvreTask):
    """Task of a sub-policy, judged by given exercises.

    Attributes:
        seeds: Their seeds.
    """

    seeds: tuple[int, ...] = ()

    @property
    def held_out(self) -> Sequence[int]:
        """See `Task`."""
        return self.seeds


def work(options: Options, job: Job) -> Iterator[Row]:
    """Drives the exercises of one training without exploration.

    Raises:
        InvalidInputError: The training is missing or damaged.
    """
    torch.set_num_threads(1)
    arm, seed, policy, *_ = job[0]
    trained = read_sub_policies(run_folder(options.runs, arm, seed or 0, policy).parent, (policy,))
    actor, seeds = trained.policies[policy].actor, tuple(cell.seed or 0 for cell in job)
    task = Exercises(policy, trained.state, steering=trained.steering, seeds=seeds)
    with closing(task.make_environments(1, processes=False)) as environments:
        for outcome in evaluate(task, environments, lambda seen: actor(seen[SINGLE]).detach().numpy()).outcomes:
            shares = {"success": 100.0 * outcome.success, "infraction": 100.0 * outcome.measures["infraction"]}
            yield {"seed": outcome.seed, "return": round(outcome.total, 3), **shares}


STUDY = Study(
    summary="GHRL's sub-policies on held-out exercises: the share of guidance, and the form of the reward",
    room=Path(__file__).parents[1],
    published="held_out",
    options=Options,
    cells=cells,
    work=work,
    tables={"held-out": held_out_tables.tables},
    together=lambda cell: (cell.arm, cell.training_seed, cell.benchmark),
    judged=held_out_tables.judged,
)
