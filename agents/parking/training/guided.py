"""Lots with an expert in each kart, which a collector asks for actions, and without reverse torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector.utils import batch_space

from dohyo.agents.parking.expert.expert import Expert
from dohyo.agents.parking.expert.scene import scene_of
from dohyo.sumo_networks.arrays import BoolArray, Float32Array, IntArray
from dohyo.sumo_networks.parking.observation import State
from dohyo.sumo_networks.parking.vector_env import Level, ParkingVectorEnv


def forward_actions() -> Box:
    """Actions without reverse torque: the second reward of the thesis ends an episode at the first negative torque."""
    return Box(np.array([0.0, -1.0, -1.0], np.float32), np.array([1.0, 1.0, 1.0], np.float32))


class GuidedVectorEnv(ParkingVectorEnv):
    """Lots with experts; see `ParkingVectorEnv`."""

    def __init__(self, lots: int, levels: Sequence[Level], karts: int = 1, state: State = "oriented") -> None:
        """See `ParkingVectorEnv`."""
        super().__init__(lots, levels, karts, state)
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

    def _begin_seeded(self, rows: IntArray, seeds: Sequence[int | None], options: Mapping[str, Any]) -> None:
        super()._begin_seeded(rows, seeds, options)
        for row in rows.tolist():
            self._experts[row] = Expert()
