"""MissionEnv: whole missions for the master, as an environment whose actions name the option that runs.

An action is (3,): pedals and steering of the option's sub-policy in [-1, 1], and the option's number. In critical
situations (RSS) the rules drive instead, if there are rules.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from dohyo.agents.hierarchical.environments.manoeuvre_env import MEASURES, DrivingTaskEnv
from dohyo.agents.hierarchical.environments.rewards import Form
from dohyo.agents.hierarchical.options.actuation import ACTIONS, Steering
from dohyo.agents.hierarchical.options.manoeuvres import DRIVE
from dohyo.agents.hierarchical.state.master_observation import FLAGS, OPTIONS, MasterObservation
from dohyo.agents.hierarchical.state.state import StateConfig, StateEncoder
from dohyo.agents.learning.tasks.task import Array, Env, Task, held_out_seeds
from dohyo.agents.rules.rules_only import RulesOnly

HELD_OUT = 10
UNDER_RULES = ("rules_share", "longest_standing_s")
"""Measures of the rules: share of the time, and longest stand in one critical interval, s."""


@dataclass(frozen=True)
class MissionTask(Task):
    """Learning problem of the master.

    Attributes:
        state: Configuration of its state.
        steering: Of the sub-policies.
        form: Form of the training's reward; held-out episodes are judged by the product.
        rules_when_critical: Whether the rules drive in critical intervals (GHRL-R).
        held_out_count: Episodes of an evaluation.
    """

    state: StateConfig
    steering: Steering = Steering.POLICY
    form: Form = "product"
    rules_when_critical: bool = False
    held_out_count: int = HELD_OUT

    @property
    def name(self) -> str:
        """See `Task`."""
        return "hierarchical-master"

    @cached_property
    def observation_space(self) -> Box:
        """See `MasterObservation.vector`."""
        return Box(-np.inf, np.inf, (StateEncoder(self.state).size + len(OPTIONS) + FLAGS,), np.float32)

    @cached_property
    def action_space(self) -> Box:
        """Pedals, steering, number of the option."""
        high = np.array([1.0] * ACTIONS + [len(OPTIONS) - 1], dtype=np.float32)
        return Box(np.array([-1.0] * ACTIONS + [0.0], dtype=np.float32), high)

    @property
    def held_out(self) -> Sequence[int]:
        """See `Task`."""
        return held_out_seeds(self.held_out_count)

    @property
    def measures(self) -> tuple[str, ...]:
        """Measures of an exercise, and those of the rules."""
        return (*MEASURES, *UNDER_RULES)

    @property
    def alone(self) -> bool:
        """See `Task`."""
        return True

    def make_env(self, rank: int) -> Env:
        """See `Task`."""
        return MissionEnv(self)


class MissionEnv(DrivingTaskEnv):
    """One ego on missions through town."""

    def __init__(self, task: MissionTask) -> None:
        """Makes the environment.

        Args:
            task: Learning problem.
        """
        self._outlook = MasterObservation(task.state, RulesOnly() if task.rules_when_critical else None)
        super().__init__(DRIVE, self._outlook.sensors, task.form)
        self.observation_space, self.action_space = task.observation_space, task.action_space
        self._steering = task.steering

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begins the scenario of a seed."""
        observation = self._begin(seed or 0)
        scenario = self.driving.scenario
        self._outlook.reset(scenario.missions[0], scenario.seed)
        self._look(observation)
        return self._outlook.vector(), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Drives one tick.

        Args:
            action: (3,), see the module.

        Raises:
            SimulationError: It has not been reset.
        """
        outlook = self._outlook
        option = OPTIONS[round(float(action[ACTIONS]))]
        if outlook.critical:
            controls = outlook.obey_rules()
        else:
            outlook.follow(option)
            controls = outlook.controls(action[:ACTIONS], self._steering)
        self._look(self._tick(controls))
        value, terminated, truncated, info = self._judge(outlook.around, arrived=False)
        return outlook.vector(), value, terminated, truncated, {**info, **(self._under_rules() if info else {})}

    def _look(self, observation: Any) -> None:
        self._outlook.update(observation)
        self.seen = self._outlook.seen

    def _under_rules(self) -> dict[str, float]:
        rules = self._outlook.rules
        shares = (rules.watch.share, rules.watch.longest_standing_s) if rules is not None else (0.0, 0.0)
        return dict(zip(UNDER_RULES, shares, strict=True))
