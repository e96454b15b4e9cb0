"""Lots with an expert in each kart, which a collector asks for actions, and without reverse torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector.utils import batch_space

from dohyo.agents.parking.expert.expert import Expert, Scene, wall_boxes
from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.observation import State
from dohyo.sumo_networks.parking.rules import Outcome
from dohyo.sumo_networks.parking.tables import OUTCOME, TARGET, WALK_RADIUS, WALK_SPEED, WALK_X, WALK_Y, WALKED
from dohyo.sumo_networks.parking.tables import OUTCOME, TARGET, WALK_RADIUS, WALK_SPEED, WALK_X, WALK_Y, WALKED
from dohyo.sumo_networks.parking.vector_env import Level, ParkingVectorEnv
from dohyo.sumo_networks.parking.world import ParkingWorld


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
            body = self.world.view(lot).karts[number]
            actions[row] = self._experts[row].act(body, scene_of(self.world, lot, number))
        return actions, rows.copy()

    def _begin_seeded(self, rows: IntArray, seeds: Sequence[int | None], options: Mapping[str, Any]) -> None:
        super()._begin_seeded(rows, seeds, options)
        for row in rows.tolist():
            self._experts[row] = Expert()


def scene_of(world: ParkingWorld, lot: int, number: int) -> Scene:
    """What the expert of a kart sees."""
    view = world.view(lot)
    others = np.flatnonzero((view.counts[:, OUTCOME] != Outcome.ABSENT) & (np.arange(len(view.karts)) != number))
    moving = np.concatenate([_karts(view.karts[others]), _pedestrians(view.walkers)])
    fixed = np.concatenate([wall_boxes(view.walls), view.boxes[:, :5]])
    return Scene(fixed, moving, view.spots[view.counts[number, TARGET], :5])


def _karts(karts: FloatArray) -> FloatArray:
    """(K, 7) boxes and velocities of karts (K, 10)."""
    size = np.tile([kart.LENGTH_M, kart.WIDTH_M], (len(karts), 1))
    velocity = karts[:, [kart.SPEED]] * karts[:, [kart.COS, kart.SIN]]
    return np.hstack([karts[:, [kart.X, kart.Y, kart.HEADING]], size, velocity])


def _pedestrians(walkers: FloatArray) -> FloatArray:
    """(P, 7) boxes and velocities of pedestrians (P, 9), who walk to and fro between two points."""
    way = walkers[:, 2:4] - walkers[:, :2]
    length = np.maximum(np.hypot(*way.T), 1e-9)
    back = walkers[:, WALKED] % (2.0 * length) > length
    speed = np.where(back, -1.0, 1.0) * walkers[:, WALK_SPEED] / length
    size = 2.0 * np.repeat(walkers[:, [WALK_RADIUS]], 2, axis=1)
    there = np.hstack([walkers[:, [WALK_X, WALK_Y]], np.zeros((len(walkers), 1)), size])
    return np.hstack([there, speed[:, None] * way])
