"""Study `ghrl-policies`: the best policy of each training on many held-out exercises, the same for all arms.

    python -m dohyo.agents.studies ghrl-policies run --set runs=runs/study --workers 2
    python -m dohyo.agents.studies ghrl-policies table --write

A training chooses its best policy by thirty exercises, too few to compare arms. Here that policy drives others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import torch
from tensordict import TensorDict

from dohyo.agents.hierarchical.hierarchy import read_sub_policies
from dohyo.agents.hierarchical.study.arms import ARMS, SUB_POLICIES
from dohyo.agents.hierarchical.training.tasks import ManoeuvreTask
from dohyo.agents.learning.runs.evaluation import Acting, evaluate
from dohyo.agents.learning.tasks.task import SINGLE, Array
from dohyo.agents.studies.arms import Block, Cell, Place, cells_of
from dohyo.agents.studies.claims import Claim, Judgement, Relation, judge
from dohyo.agents.studies.crossed_bootstrap import by_training, estimate
from dohyo.agents.studies.rows import Row, arms_in, matched
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.study import Results, Study
from dohyo.agents.studies.tables import PAGE, claims_table, each_training
from dohyo.agents.studies.training_results import run_folder
from dohyo.evaluation.report.style import interval, markdown
from dohyo.evaluation.statistics import mean_estimate
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.seeds import HELD_OUT_FROM

FIRST = HELD_OUT_FROM + 1000
"""First seed: a training uses at most the thousand seeds before for its own evaluations."""
MEASURES: Final[Mapping[str, tuple[str, Relation]]] = {
    "return": ("return", ">"), "success": ("success, %", ">"), "infraction": ("infractions, %", "<"),
}  # fmt: skip
"""Heads, and what a better arm has."""
PAIRS: Final = (
    ("p-5", "hrl", 27), ("p-10", "hrl", 27), ("p-20", "hrl", 27), ("p-20", "p-5", 27), ("p-10", "p-10-sum", 28),
    ("ghrl", "p-10", 0), ("ghrl", "ghrl-pictures", 0),
)  # fmt: skip
"""Claims: the first arm is better; with the theses' comparison that each decides."""


class Options(Config):
    """Options of a run.

    Attributes:
        runs: Folder of the trainings.
    """

    runs: Path = Path("runs/study")


def exercises(policy: str, count: int) -> list[Place]:
    """Held-out exercises of a sub-policy."""
    return [Place(policy, "held-out", FIRST + number) for number in range(count)]


def cells(options: Options) -> list[Cell]:
    """Every cell of the published tables."""
    lights, lane, braking = exercises("lights", 200), exercises("lane", 100), exercises("braking", 100)
    blocks = (
        Block(("hrl", "p-5", "p-10", "p-20", "p-10-sum", "ghrl"), (0, 1, 2), lights),
        Block(("ghrl-pictures",), (0,), lights),
        Block(("hrl", "p-20"), (0, 1, 2), lane),
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
    seeds = tuple(cell.seed or 0 for cell in job)
    task = Exercises(policy, trained.state, steering=trained.steering, seeds=seeds)
    environments = task.make_environments(1, processes=False)
    try:
        for outcome in evaluate(task, environments, acting(trained.policies[policy].actor)).outcomes:
            shares = {"success": 100.0 * outcome.success, "infraction": 100.0 * outcome.measures["infraction"]}
            yield {"seed": outcome.seed, "return": round(outcome.total, 3), **shares}
    finally:
        environments.close()


def acting(actor: torch.nn.Module) -> Acting:
    """Actions of an actor, without exploration."""

    def act(observation: TensorDict) -> Array:
        with torch.no_grad():
            action: Array = actor(observation[SINGLE]).numpy()
        return action

    return act


def tables(results: Results) -> str:
    """Results of each arm, and claims, as Markdown."""
    by_policy = {policy: [row for row in results.rows if row["benchmark"] == policy] for policy in SUB_POLICIES}
    means = [
        [policy, arm, ", ".join(map(str, by_training(matched(rows, arm, "return")))), *_means(rows, arm)]
        for policy, rows in by_policy.items()
        for arm in arms_in(rows, [*ARMS])
    ]
    before = {
        "policy": lambda one: one.claim.where,
        "claim": lambda one: str(one.claim),
        "of": lambda one: MEASURES[one.claim.measure][0],
        "each training": each_training,
    }
    heads = ["policy", "arm", "trainings", *(head for head, _ in MEASURES.values())]
    return "\n\n".join(part for part in (markdown(heads, means), claims_table(judged(results), before)) if part)


def judged(results: Results) -> list[Judgement]:
    """Each claim for each sub-policy and measure."""
    return judge(
        [
            Claim(left, relation, right, measure, policy, ablation=number)
            for policy in SUB_POLICIES
            for left, right, number in PAIRS
            for measure, (_, relation) in MEASURES.items()
        ],
        lambda claim, arm: matched(
            [row for row in results.rows if row["benchmark"] == claim.where], arm, claim.measure
        ),
    )


def _means(rows: list[Row], arm: str) -> list[str]:
    return [interval(estimate(matched(rows, arm, measure), mean_estimate)) for measure in MEASURES]


STUDY = Study(
    summary="GHRL's sub-policies on held-out exercises: the share of guidance, and the form of the reward",
    stored=Path(__file__).parents[1].joinpath("results") / "held_out",
    page=Path(__file__).parents[1].joinpath(PAGE),
    options=Options,
    cells=cells,
    work=work,
    tables={"held-out": tables},
    together=lambda cell: (cell.arm, cell.training_seed, cell.benchmark),
    judged=judged,
)
