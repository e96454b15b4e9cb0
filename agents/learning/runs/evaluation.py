"""Evaluation of a policy on a task's held-out episodes."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from dohyo.agents.learning.files.metrics import Number
from dohyo.agents.learning.runs.config import Merit
from dohyo.agents.learning.runs.run import RunStoppedError
from dohyo.agents.learning.tasks.task import Array, Environments, Task
from dohyo.evaluation.statistics import Estimate, mean_estimate, share_estimate
from dohyo.sumo_networks.arrays import BoolArray
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError

logger = logging.getLogger(__name__)

COLUMNS = ("updates", "episodes", "return", "return_low", "return_high", "success", "success_low", "success_high")


def columns_of(task: Task) -> tuple[str, ...]:
    """Columns of a task's evaluations.csv after the step.

    Raises:
        InvalidInputError: A measure of the task has the name of another column.
    """
    names = (*COLUMNS, "length", *task.measures)
    twice = {name for name in names if names.count(name) > 1} | ({"steps"} & set(names))
    if twice:
        raise InvalidInputError(
            f"task '{task.name}': expected measures with names of their own, got {', '.join(sorted(twice))}"
        )
    return names


Acting = Callable[[TensorDict], Array]
"""Policy without exploration: observations by name (N,) -> (N, ...) actions in the action space."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """A held-out episode.

    Attributes:
        seed: Of its reset.
        total: Undiscounted return.
        length: Its steps.
        success: Whether it succeeded.
        measures: The task's measures.
    """

    seed: int
    total: float
    length: int
    success: bool
    measures: Mapping[str, float]


@dataclass(frozen=True)
class Evaluation:
    """Results of a policy on the held-out episodes.

    Attributes:
        outcomes: One per episode that was not lost, in the order of the seeds.
    """

    outcomes: Sequence[Outcome]

    @property
    def mean_return(self) -> Estimate:
        """Mean undiscounted return of an episode, with a 95 % interval."""
        return mean_estimate([outcome.total for outcome in self.outcomes])

    @property
    def success(self) -> Estimate:
        """Share of successes, %, with a 95 % interval."""
        return share_estimate([outcome.success for outcome in self.outcomes])

    @property
    def measures(self) -> dict[str, float]:
        """Mean of each of the task's measures."""
        names = self.outcomes[0].measures
        return {name: _mean([outcome.measures[name] for outcome in self.outcomes]) for name in names}

    def better_than(self, other: Mapping[str, Number], best_by: Merit) -> bool:
        """Whether the policy is better than that of a row of evaluations.csv; see `RunConfig.best_by`."""
        names = ("success", "return") if best_by == "success" else ("return",)
        own = self.values()
        return _ranked(own, names) > _ranked(other, names)

    def values(self) -> dict[str, Number]:
        """Row of evaluations.csv."""
        value, success = self.mean_return, self.success
        return {
            "episodes": len(self.outcomes),
            "return": value.mean,
            "return_low": value.low,
            "return_high": value.high,
            "success": success.mean,
            "success_low": success.low,
            "success_high": success.high,
            "length": _mean([outcome.length for outcome in self.outcomes]),
            **self.measures,
        }


def evaluate(
    task: Task, environments: Environments, act: Acting, stopping: Callable[[], bool] = lambda: False
) -> Evaluation:
    """Drives every held-out episode, of the curriculum's last level.

    Args:
        task: Gives the seeds.
        environments: Of the evaluation alone; as many episodes at once as it has rows.
        act: The policy.
        stopping: Called at every step.

    Raises:
        RunStoppedError: `stopping` returned True.
        SimulationError: Every episode's simulation failed; single failures are left out.
    """
    outcomes: list[Outcome] = []
    seeds, count = list(task.held_out), environments.num_envs
    for first in range(0, len(seeds), count):
        outcomes += _drive(task, environments, seeds[first : first + count], act, stopping)
    if not outcomes:
        raise SimulationError(f"task '{task.name}': every held-out episode was lost")
    return Evaluation(outcomes)


def _drive(
    task: Task, environments: Environments, seeds: Sequence[int], act: Acting, stopping: Callable[[], bool]
) -> list[Outcome]:
    """Episodes that are driven together, in the first rows."""
    count, rows = environments.num_envs, len(seeds)
    driven = np.arange(count) < rows
    observation, infos = _reset(task, environments, seeds)
    totals, lengths = np.zeros(count), np.zeros(count, np.int64)
    lost = driven & infos.get("lost", False)
    over: BoolArray = ~driven | lost
    ended: list[Outcome | None] = [None] * count
    while not over.all():
        if stopping():
            raise RunStoppedError("stopped in an evaluation")
        seen = TensorDict({name: torch.from_numpy(array) for name, array in observation.items()}, [count])
        observation, reward, terminated, truncated, infos = environments.step(act(seen))
        active = ~over & infos.get("active", True)
        totals[active] += reward[active]
        lengths += active
        failed = ~over & infos.get("lost", False)
        for row in np.flatnonzero(active & ~failed & (terminated | truncated)).tolist():
            success = bool(infos["success"][row]) if "success" in infos else False
            measures = {name: float(infos[name][row]) for name in task.measures}
            ended[row] = Outcome(seeds[row], float(totals[row]), int(lengths[row]), success, measures)
        lost |= failed
        over |= failed | (active & (terminated | truncated))
    for row in np.flatnonzero(lost).tolist():
        logger.warning("held-out episode %d is lost, and in no mean", seeds[row])
    return [outcome for outcome in ended if outcome is not None]


def _reset(task: Task, environments: Environments, seeds: Sequence[int]) -> tuple[dict[str, Array], dict[str, Any]]:
    options: dict[str, Any] = {"reset_mask": np.ones(environments.num_envs, np.bool_)}
    if task.curriculum is not None:
        options["level"] = task.curriculum.levels - 1
    # Rows without an episode of their own are reset, too: they have no observation yet.
    padded = [*seeds, *[seeds[0]] * (environments.num_envs - len(seeds))]
    return environments.reset(seed=padded, options=options)  # type: ignore[arg-type]


def _ranked(row: Mapping[str, Number], names: Sequence[str]) -> list[float]:
    return [-math.inf if (value := row[name]) is None else float(value) for name in names]


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)
