"""Endings: by what each held-out mission of a policy ends, and how fast the ego is then.

    python -m dohyo.agents.rlad.study.endings out/rlad/twin/seed-0/policy.onnx     # 2 minutes of a core

A policy that sees no red light runs it at full speed; one that sees it and comes to no stand creeps over the line.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import torch
from tensordict import TensorDict

from dohyo.agents.endless_driving.agent import town_of
from dohyo.agents.endless_driving.environment import LIGHT
from dohyo.agents.endless_driving.observation import MEASUREMENTS
from dohyo.agents.endless_driving.task import EndlessDriving
from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.learning.runs.evaluation import Outcome, evaluate
from dohyo.agents.learning.tasks.task import Array
from dohyo.evaluation.report.style import markdown

CAUSES: Final = {"red_lights": "red light", "collision": "collision", "left_route": "beside the route",
                 "blocked": "stands"}  # fmt: skip
LIGHTS: Final = ("none", "red or yellow", "green")


@dataclass(frozen=True, slots=True)
class Decision:
    """What the ego does at one moment.

    Attributes:
        speed: m/s.
        target: Speed that the policy asks for, m/s.
        light: Of `LIGHTS`.
    """

    speed: float
    target: float
    light: str


@dataclass(frozen=True, slots=True)
class Ending:
    """End of one mission.

    Attributes:
        outcome: Of the mission.
        last: Its last decision.
    """

    outcome: Outcome
    last: Decision

    @property
    def cause(self) -> str:
        """The goal, a cause of `CAUSES`, or the end of its time."""
        if self.outcome.success:
            return "goal"
        found = [told for name, told in CAUSES.items() if self.outcome.measures[name] > 0.0]
        return found[0] if found else "end of time"


def endings(policy: Path) -> list[Ending]:
    """Drives the held-out missions of a policy's training, one after the other.

    Args:
        policy: ONNX file of a training of `rlad`, with its card beside it.

    Raises:
        InvalidInputError: There is no such policy.
        SimulationError: A simulation failed.
    """
    town = town_of(policy, "rlad")
    task, drive, decisions = EndlessDriving(town), OnnxPolicy(policy), list[Decision]()

    def act(seen: TensorDict) -> Array:
        action = drive.of_batch({name: seen[name].numpy() for name in drive.inputs})
        speed, light = float(seen[MEASUREMENTS][0, -2]) * town.max_speed, LIGHTS[int(seen[LIGHT][0, 0])]
        decisions.append(Decision(speed, (float(action[0, 0]) + 1.0) / 2.0 * town.max_speed, light))
        return action

    environments = task.make_environments(1, processes=False)
    try:
        outcomes = evaluate(task, environments, act).outcomes
    finally:
        environments.close()
    ends = np.cumsum([outcome.length for outcome in outcomes]) - 1
    return [Ending(outcome, decisions[end]) for outcome, end in zip(outcomes, ends.tolist(), strict=True)]


def table(found: Sequence[Ending]) -> str:
    """A row per mission."""
    heads = ["mission", "return", "completion, %", "ends by", "speed, m/s", "asks for, m/s", "light ahead"]
    rows = [
        [
            str(number), f"{one.outcome.total:.0f}", f"{one.outcome.measures['completion']:.0f}", one.cause,
            f"{one.last.speed:.1f}", f"{one.last.target:.1f}", one.last.light,
        ]
        for number, one in enumerate(found, start=1)
    ]  # fmt: skip
    return markdown(heads, rows)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", type=Path)
    torch.set_num_threads(1)
    print(table(endings(parser.parse_args().policy)))


if __name__ == "__main__":
    main()
