"""Sub-policies: each manoeuvre as a task of its own, with its scenarios, its part of the state, and its reward.

    dohyo train hierarchical-lights --config agents/hierarchical/configs/lights.toml

Learned by PPO, guided by the answer-set rules in the same world (GPPO). The flat policy, which learns all
manoeuvres, is one of them. Source: Albilani 2023, section 6.2.4 and algorithm 10.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from dohyo.agents.hierarchical.environments.rewards import Form
from dohyo.agents.hierarchical.options.actuation import Steering
from dohyo.agents.hierarchical.options.manoeuvres import DRIVE, Manoeuvre
from dohyo.agents.hierarchical.state.state import StateConfig
from dohyo.agents.hierarchical.training.tasks import HELD_OUT, ManoeuvreTask
from dohyo.agents.learning.algorithms.ppo import ppo_trainer
from dohyo.agents.learning.algorithms.ppo_config import PpoRunConfig
from dohyo.agents.learning.runs.trainer import Trainer
from dohyo.agents.learning.tasks.task import Task


class SubPolicyConfig(PpoRunConfig):
    """A training of one sub-policy.

    Attributes:
        state: Configuration of the state.
        form: Reward in training: the terms' "product", or their "sum"; the product judges held-out episodes.
        steering: "policy", or "residual": pure pursuit steers, and the policy corrects it.
        held_out: Episodes of an evaluation.
    """

    state: StateConfig = StateConfig()
    form: Form = "product"
    steering: Steering = Steering.POLICY
    held_out: Annotated[int, Field(gt=0, le=1000)] = HELD_OUT


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
