"""Held-out episodes of the learned parts: trained policies beside the shipped ones and the baselines, paired by seed.

python -m dohyo.agents.speed_planning.study.held_out --buffer runs/buffer/* --cruise-control runs/cruise/* --results
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from tensordict import TensorDict

from dohyo.agents.learning.networks.policy import TanhActor
from dohyo.agents.learning.runs.evaluation import Acting, Evaluation, evaluate
from dohyo.agents.learning.tasks.task import SINGLE, Array, Task
from dohyo.agents.speed_planning import acc, buffer
from dohyo.agents.speed_planning.buffer import RuleBuffer, Squeeze
from dohyo.agents.speed_planning.training.buffer_training import BufferTask
from dohyo.agents.speed_planning.training.cruise_control_training import CruiseControlTask
from dohyo.agents.speed_planning.training.macroscopic import CellRoad
from dohyo.agents.studies.tables import PAGE, write_section
from dohyo.evaluation.report.style import markdown
from dohyo.evaluation.statistics import Estimate, mean_estimate, paired

POLICY = "policy.safetensors"
"""The last policy of a run; its best one was chosen on the held-out episodes themselves."""
Judged = dict[str, Evaluation]
"""Held-out episodes by policy; the two baselines come first."""


def no_buffer(seen: TensorDict) -> Array:
    """Asks for the critical density, which is no request."""
    return np.full((*seen.batch_size, 1), -1.0, np.float32)


class Rule:
    """The rule of the buffer as a policy of the task; its feedback begins with the first observation."""

    def __init__(self) -> None:
        self._rule, self._diagram = RuleBuffer(), CellRoad().diagram

    def __call__(self, seen: TensorDict) -> Array:
        """(N, O) -> (N, 1)."""
        profile = seen[SINGLE][:, :-1].double().numpy() * self._diagram.jam_density
        density = self._rule.density(profile, Squeeze(1, 1), self._diagram)  # it does not look at the lanes
        return buffer.action_of_density(density, self._diagram)[:, None].astype(np.float32)


def follows_traffic(seen: TensorDict) -> Array:
    """The cruise control left at 80 mph and the middle gap: it only follows."""
    return np.tile(np.array([1.0, 0.0], np.float32), (*seen.batch_size, 1))


def follows_plan(seen: TensorDict) -> Array:
    """The plan's speed, rounded up to whole m/s, and the middle gap, as a driver could set them by hand."""
    plan = seen[SINGLE][:, 7].double().numpy() * 40
    return np.stack([np.ceil(plan) / 20 - 1 + 1e-6, np.zeros(len(plan))], axis=1).astype(np.float32)


def learned(path: Path) -> Acting:
    """A stored policy.

    Raises:
        InvalidInputError: The file is missing, or holds no policy.
    """
    actor = TanhActor.load(path)
    return lambda seen: actor.act(seen[SINGLE].numpy())


def judged(task: Task, policies: Mapping[str, Acting]) -> Judged:
    """Drives the held-out episodes."""
    environments = task.make_environments(task.judged_at_once, processes=False)
    return {name: evaluate(task, environments, act) for name, act in policies.items()}


def judged_buffers(runs: Sequence[Path]) -> Judged:
    """No buffer, the rule, the shipped policy, and those of some runs."""
    found = judged(BufferTask(), {"none": no_buffer})
    found |= judged(BufferTask(RuleBuffer().length_m), {"rule": Rule()})
    return found | judged(BufferTask(), _learned(buffer.CHECKPOINT, runs))


def judged_set_points(runs: Sequence[Path]) -> Judged:
    """Two settings by hand, the shipped policy, and those of some runs."""
    by_hand: dict[str, Acting] = {"follows-traffic": follows_traffic, "follows-plan": follows_plan}
    return judged(CruiseControlTask(), {**by_hand, **_learned(acc.CHECKPOINT, runs)})


def table(found: Judged, unit: float, measures: Mapping[str, str]) -> str:
    """Markdown: every policy's mean reward per decision, its difference from the two baselines, and some measures.

    Args:
        found: Held-out episodes.
        unit: Factor of the rewards shown.
        measures: Heads of measures by name.
    """
    first, second = list(found)[:2]
    heads = ["policy", "n", "mean per decision", f"against {first}", f"against {second}", *measures.values()]
    earned = {name: [one.total / one.length for one in evaluation.outcomes] for name, evaluation in found.items()}
    rows = []
    for name, values in earned.items():
        shown = [_shown(mean_estimate(values), unit, "")]
        for other in (first, second):
            comparison = paired(values, earned[other])
            shown.append("" if name == other else f"{_shown(comparison.difference, unit, '+')} {comparison.verdict}")
        measured = [f"{found[name].measures[measure]:.2f}" for measure in measures]
        rows.append([name, str(len(values)), *shown, *measured])
    return markdown(heads, rows)


def _learned(shipped: Path, runs: Sequence[Path]) -> dict[str, Acting]:
    return {"shipped": learned(shipped), **{f"PPO, {run.name}": learned(run / POLICY) for run in runs}}


def _shown(estimate: Estimate, unit: float, sign: str) -> str:
    mean, low, high = (unit * (value or 0.0) for value in (estimate.mean, estimate.low, estimate.high))
    return f"{mean:{sign}.3f} [{low:{sign}.3f}, {high:{sign}.3f}]"


def main() -> None:
    """Command-line entry point."""
    parser = argparse.ArgumentParser(prog="python -m dohyo.agents.speed_planning.study.held_out", description=__doc__)
    parser.add_argument("--buffer", type=Path, nargs="*", default=[], metavar="RUN", help="runs of speed-buffer")
    parser.add_argument("--cruise-control", type=Path, nargs="*", default=[], metavar="RUN", help="runs of that name")
    parser.add_argument("--results", action="store_true", help="write the tables into RESULTS.md")
    given = parser.parse_args()
    torch.set_num_threads(1)
    tables = {
        "buffer": table(judged_buffers(given.buffer), 100.0, {"requested_mps": "requested speed, m/s"}),
        "cruise-control": table(
            judged_set_points(given.cruise_control), 1.0, {"fuel_g_s": "fuel of a car, g/s", "speed_mps": "speed, m/s"}
        ),
    }
    for name, text in tables.items():
        print(text)
        if given.results:
            write_section(Path(__file__).parents[1].joinpath(PAGE), name, text)


if __name__ == "__main__":
    main()
