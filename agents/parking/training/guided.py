"""Lots with an expert in each kart, which a collector asks for actions, and without reverse torque."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector.utils import batch_space

from dohyo.agents.parking.expert.expert import Expert
from dohyo.agents.parking.expert.scene import scene_of
from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.parking.vector_env import Level, ParkingVectorEnv

KEPT: Final = 0.9
"""Share of a disturbance that is left after a tick."""


def forward_actions() -> Box:
    """Actions without reverse torque: the second reward of the thesis ends an episode at the first negative torque."""
    return Box(np.array([0.0, -1.0, -1.0], np.float32), np.array([1.0, 1.0, 1.0], np.float32))


class GuidedVectorEnv(ParkingVectorEnv):
    """Lots with experts; see `ParkingVectorEnv`.

    Attributes:
        disturbance: Standard deviation of what is added to every action, shares of the maxima. It changes slowly, so
            that an expert's demonstrations show how to come back (DART, Laskey et al. 2017).
    """

    def __init__(self, lots: int, levels: Sequence[Level], karts: int = 1, disturbance: float = 0.0) -> None:
        """See `ParkingVectorEnv` and the class."""
        super().__init__(lots, levels, karts)
        self.disturbance = disturbance
        self._generators = [np.random.default_rng(0) for _ in range(self.num_envs)]
        self._added = np.zeros((self.num_envs, 3))
        self.single_action_space = forward_actions()
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._experts = [Expert() for _ in range(self.num_envs)]

    def expert_actions(self, rows: BoolArray) -> tuple[Float32Array, BoolArray]:
        """Actions of the experts in (N,) rows; (N, 3), and (N,) whether there is one."""
        actions = np.zeros((self.num_envs, 3), np.float32)
        for row in np.flatnonzero(rows).tolist():
            lot, number = divmod(row, self.group_size)
            view = self.world.view(lot)
            actions[row] = self._experts[row].act(view.karts[number], scene_of(view, number))
        return actions, rows.copy()

    def _advance(self, rows: IntArray, actions: FloatArray) -> FloatArray:
        if not self.disturbance:
            return super()._advance(rows, actions)
        drawn = np.array([self._generators[row].standard_normal(3) for row in rows.tolist()])
        self._added[rows] = KEPT * self._added[rows] + math.sqrt(1.0 - KEPT**2) * self.disturbance * drawn
        space: Any = self.single_action_space
        return super()._advance(rows, np.clip(actions + self._added[rows], space.low, space.high))

    def _begin_seeded(self, rows: IntArray, seeds: Sequence[int | None], options: Mapping[str, Any]) -> None:
        super()._begin_seeded(rows, seeds, options)
        for row, seed in zip(rows.tolist(), seeds, strict=True):
            self._experts[row] = Expert()
            self._generators[row] = np.random.default_rng([row % self.group_size, seed or 0])
        self._added[rows] = 0.0
