"""Training of a cruise control's set-points behind random leaders.

    dohyo train cruise-control --config agents/speed_planning/configs/cruise_control.toml --out runs/cruise/seed-0

The field test's policy took 33 million steps of 0.1 s; this is the same algorithm on the same kind of platoon for
fewer, with a decision every 0.5 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from gymnasium.spaces import Box

from dohyo.agents.learning.algorithms.ppo import ppo_trainer
from dohyo.agents.learning.algorithms.ppo_config import PpoConfig, PpoRunConfig
from dohyo.agents.learning.runs.config import Positive
from dohyo.agents.learning.tasks.task import Environments, Task, held_out_seeds
from dohyo.agents.speed_planning.acc import ACTIONS, OBSERVATIONS
from dohyo.agents.speed_planning.training.platoon import DECISIONS, MEASURES, PlatoonEnv

HELD_OUT = 64


@dataclass(frozen=True)
class CruiseControlTask(Task):
    """Learning problem of the set-points, see `PlatoonEnv`."""

    name = "cruise-control"
    observation_space = Box(-np.inf, np.inf, (OBSERVATIONS,), np.float32)
    action_space = Box(-1.0, 1.0, (ACTIONS,), np.float32)
    held_out: Sequence[int] = held_out_seeds(HELD_OUT)
    measures = MEASURES
    judged_at_once = HELD_OUT

    def make_environments(self, count: int, processes: bool) -> Environments:
        """See `Task`; all rows are in this process."""
        return PlatoonEnv(count)


class CruiseControlConfig(PpoRunConfig):
    """A training of the set-points.

    Attributes:
        processes: None: one process advances all platoons.
        environments: Platoons.
    """

    processes: Literal[0] = 0
    environments: Positive = 64
    ppo: PpoConfig = PpoConfig(horizon=DECISIONS, squashed=True)


CRUISE_CONTROL = ppo_trainer(
    "set-points of a car's cruise control", CruiseControlConfig, lambda config: CruiseControlTask()
)
