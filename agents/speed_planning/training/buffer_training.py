"""Training of the buffer's density in the macroscopic model.

dohyo train speed-buffer --config agents/speed_planning/configs/buffer.toml --out runs/buffer/seed-0
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
from dohyo.agents.speed_planning import buffer
from dohyo.agents.speed_planning.training.buffer_env import DECISIONS, MEASURES, BufferEnv

HELD_OUT = 64


@dataclass(frozen=True)
class BufferTask(Task):
    """Learning problem of the buffer, see `BufferEnv`.

    Attributes:
        length_m: Of the buffer.
    """

    length_m: float = buffer.TRAINED_M

    name = "speed-buffer"
    observation_space = Box(-np.inf, np.inf, (buffer.CELLS + 1,), np.float32)
    action_space = Box(-1.0, 1.0, (1,), np.float32)
    held_out: Sequence[int] = held_out_seeds(HELD_OUT)
    measures = MEASURES
    judged_at_once = HELD_OUT

    def make_environments(self, count: int, processes: bool) -> Environments:
        """See `Task`; all rows are in this process."""
        return BufferEnv(count, self.length_m)


class BufferConfig(PpoRunConfig):
    """A training of the buffer.

    Attributes:
        processes: None: one process advances all roads.
        environments: Roads.
    """

    processes: Literal[0] = 0
    environments: Positive = 32
    ppo: PpoConfig = PpoConfig(horizon=DECISIONS, squashed=True)


BUFFER = ppo_trainer("density of the buffer before a bottleneck", BufferConfig, lambda config: BufferTask())
