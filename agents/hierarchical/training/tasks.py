"""Tasks: each manoeuvre as a learning problem. Without torch, since the processes of environments import this."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from gymnasium.spaces import Box

from dohyo.agents.hierarchical.environments.manoeuvre_env import MEASURES, ManoeuvreEnv
from dohyo.agents.hierarchical.environments.rewards import Form
from dohyo.agents.hierarchical.options.actuation import ACTIONS, Steering
from dohyo.agents.hierarchical.state.state import StateConfig, StateEncoder
from dohyo.agents.hierarchical.state.views import rows_seen
from dohyo.agents.learning.tasks.task import Env, Task, held_out_seeds

HELD_OUT = 20


@dataclass(frozen=True)
class ManoeuvreTask(Task):
    """Learning problem of a sub-policy, or of the flat policy.

    Attributes:
        what: A `Manoeuvre`, or "drive".
        state: Configuration of the state.
        form: Form of the training's reward; held-out episodes are judged by the product.
        steering: Kind of steering.
        held_out_count: Episodes of an evaluation.
    """

    what: str
    state: StateConfig = field(default_factory=StateConfig)
    form: Form = "product"
    steering: Steering = Steering.POLICY
    held_out_count: int = HELD_OUT

    @property
    def name(self) -> str:
        """See `Task`."""
        return f"hierarchical-{self.what}"

    @cached_property
    def observation_space(self) -> Box:
        """Space of the part of the state that the manoeuvre sees."""
        return Box(-np.inf, np.inf, (len(rows_seen(StateEncoder(self.state), self.what)),), np.float32)

    @cached_property
    def action_space(self) -> Box:
        """Pedals and steering, see `actuation.command`."""
        return Box(-1.0, 1.0, (ACTIONS,), np.float32)

    @property
    def held_out(self) -> Sequence[int]:
        """See `Task`."""
        return held_out_seeds(self.held_out_count)

    @property
    def measures(self) -> tuple[str, ...]:
        """See `exercise.MEASURES`."""
        return MEASURES

    @property
    def alone(self) -> bool:
        """See `Task`."""
        return True

    @property
    def has_expert(self) -> bool:
        """The rules."""
        return True

    def make_env(self, rank: int) -> Env:
        """See `Task`."""
        return ManoeuvreEnv(self)
