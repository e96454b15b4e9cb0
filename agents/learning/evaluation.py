"""Evaluation of a policy on a task's held-out episodes."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from dohyo.agents.learning.metrics import Number
from dohyo.agents.learning.run import RunStoppedError
from dohyo.agents.learning.task import Array, Task
from dohyo.agents.learning.worker import Seat, View
from dohyo.evaluation.statistics import Estimate, mean_estimate, share_estimate
from dohyo.sumo_networks.errors import SimulationError

logger = logging.getLogger(__name__)

COLUMNS = ("updates", "episodes", "return", "return_low", "return_high", "success", "success_low", "success_high")


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Results of a policy on the held-out episodes.

    Attributes:
        returns: One per episode.
        successes: One per episode.
        lengths: Steps, one per episode.
        measures: Mean of each of the task's measures.
    """

    returns: Sequence[float]
    successes: Sequence[bool]
    lengths: Sequence[int]
    measures: dict[str, float]

    @property
    def mean_return(self) -> Estimate:
        """Mean undiscounted return of an episode, with a 95 % interval."""
        return mean_estimate(self.returns)

    @property
    def success(self) -> Estimate:
        """Share of successes, %, with a 95 % interval."""
        return share_estimate(self.successes)

    def higher_than(self, other: Mapping[str, Number]) -> bool:
        """Whether the mean return is above that of a row of evaluations.csv."""
        mean, before = self.mean_return.mean, other["return"]
        return mean is not None and (before is None or mean > before)

    def values(self) -> dict[str, Number]:
        """Row of evaluations.csv."""
        value, success = self.mean_return, self.success
        return {
            "episodes": len(self.returns),
            "return": value.mean,
            "return_low": value.low,
            "return_high": value.high,
            "success": success.mean,
            "success_low": success.low,
            "success_high": success.high,
            "length": math.fsum(self.lengths) / len(self.lengths),
            **self.measures,
        }


def evaluate(
    task: Task, seat: Seat, act: Callable[[Array], Array], stopping: Callable[[], bool] = lambda: False
) -> Evaluation:
    """Drives every held-out episode.

    Args:
        task: Gives the seeds.
        seat: Worker of the evaluation's environment.
        act: Maps one observation to an action in the action space, without exploration.
        stopping: Called at every step.

    Raises:
        RunStoppedError: `stopping` returned True.
        SimulationError: Every episode's simulation failed; single failures are left out.
    """
    returns, successes, lengths = [], [], []
    measures: dict[str, list[float]] = {name: [] for name in task.measures}
    for seed in task.held_out:
        try:
            total, length, last = _drive(seat, seed, act, stopping)
        except SimulationError as error:
            logger.warning("held-out episode %d is lost, and in no mean: %s", seed, error)
            seat.renew()
            continue
        returns.append(total)
        successes.append(last.success)
        lengths.append(length)
        for name, value in (last.measures or {}).items():
            measures[name].append(value)
    if not returns:
        raise SimulationError(f"task '{task.name}': every held-out episode was lost")
    means = {name: math.fsum(values) / len(values) for name, values in measures.items()}
    return Evaluation(returns, successes, lengths, means)


def _drive(
    seat: Seat, seed: int, act: Callable[[Array], Array], stopping: Callable[[], bool]
) -> tuple[float, int, View]:
    """Return, steps and end of one episode."""
    seat.send("reset", seed, False)
    view, total, length = seat.receive(), 0.0, 0
    while not view.ended:
        if stopping():
            raise RunStoppedError("stopped in an evaluation")
        seat.send("step", act(view.observation))
        view = seat.receive()
        total, length = total + view.reward, length + 1
    return total, length, view
