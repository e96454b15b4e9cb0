"""Judgement of last policies and of experts, on held-out episodes that no evaluation of a training uses."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from tensordict import TensorDict

from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.learning.runs.evaluation import evaluate
from dohyo.agents.learning.tasks.task import Array, Task
from dohyo.agents.studies.rows import Row
from dohyo.sumo_networks.seeds import HELD_OUT_FROM

JUDGED: Final = range(HELD_OUT_FROM + 1_000_000, HELD_OUT_FROM + 1_000_020)
"""Seeds of the episodes; evaluations of trainings use lower ones."""


def judged(task: Task, policy: OnnxPolicy | None) -> dict[int, Row]:
    """Measures of the held-out episodes of a task, by their seeds.

    Args:
        task: What is judged on.
        policy: Acts; None: the task's own expert.
    """
    environments: Any = task.make_environments(1, processes=task.alone)

    def act(observation: TensorDict) -> Array:
        if policy is None:
            actions: Array = environments.expert_actions(np.ones(1, np.bool_))[0]
            return actions
        return policy.of_batch({name: values.numpy() for name, values in observation.items()})

    try:
        outcomes = evaluate(task, environments, act).outcomes
    finally:
        environments.close()
    return {one.seed: {"return": one.total, "success": 100.0 * one.success, **one.measures} for one in outcomes}
