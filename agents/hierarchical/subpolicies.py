"""Sub-policies: each manoeuvre as a task of its own, with its scenarios, its part of the state, and its reward.

    dohyo train hierarchical-lights --config agents/hierarchical/configs/lights.toml

Learned by PPO, guided by the answer-set rules in the same world (GPPO). The flat policy, which has to do everything
alone, is one of them. Source: Albilani 2023, section 6.2.4 and algorithm 10.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated

import numpy as np
from gymnasium.spaces import Box
from pydantic import Field

from agents.hierarchical.actuation import ACTIONS, Steering
from agents.hierarchical.exercise import MEASURES, Exercise
from agents.hierarchical.manoeuvres import DRIVE, Manoeuvre
from agents.hierarchical.rewards import Form
from agents.hierarchical.state import StateConfig, StateEncoder
from agents.hierarchical.views import rows_seen
from agents.training.config import PpoRunConfig
from agents.training.ppo import ppo_trainer
from agents.training.registry import Trainer
from agents.training.task import Array, Env, Task, held_out_seeds

HELD_OUT = 20


class SubPolicyConfig(PpoRunConfig):
    """A training of one sub-policy.

    Attributes:
        state: What the policy sees.
        form: Of the reward: the terms' "product", or their "sum".
        steering: "policy", or "residual": pure pursuit steers, and the policy corrects it.
        held_out: Episodes of an evaluation.
    """

    state: StateConfig = StateConfig()
    form: Form = "product"
    steering: Steering = Steering.POLICY
    held_out: Annotated[int, Field(gt=0, le=1000)] = HELD_OUT


@dataclass(frozen=True)
class ManoeuvreTask(Task):
    """What one sub-policy learns, or the flat policy.

    Attributes:
        what: A `Manoeuvre`, or "drive".
        state: What the policy sees.
        form: Of the reward.
        steering: Who steers.
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
        """The part of the state that the manoeuvre sees."""
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

    def make_env(self, seed: int, rank: int) -> Env:
        """See `Task`."""
        return Exercise(self)

    def expert(self, env: Env) -> Array | None:
        """What the rules would do."""
        assert isinstance(env, Exercise)
        return env.advice()


def _trainer(what: str, summary: str) -> Trainer[SubPolicyConfig]:
    def task_of(config: SubPolicyConfig) -> Task:
        return ManoeuvreTask(what, config.state, config.form, config.steering, config.held_out)

    return ppo_trainer(summary, SubPolicyConfig, task_of)


LANE = _trainer(Manoeuvre.LANE, "GHRL's sub-policy that keeps its lane")
LEFT = _trainer(Manoeuvre.LEFT, "GHRL's sub-policy that changes to the lane on the left")
RIGHT = _trainer(Manoeuvre.RIGHT, "GHRL's sub-policy that changes to the lane on the right")
BRAKING = _trainer(Manoeuvre.BRAKING, "GHRL's sub-policy that stops for what is in the way, and drives on")
LIGHTS = _trainer(Manoeuvre.LIGHTS, "GHRL's sub-policy for junctions with lights")
FLAT = _trainer(DRIVE, "the flat policy that GHRL is compared with: everything in one")
