"""Lots with an expert in each kart, which a collector asks for actions, and without reverse torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector.utils import batch_space

from dohyo.agents.parking.expert import Expert, Scene, wall_boxes
from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.kernel import walker_place
from dohyo.sumo_networks.parking.observation import State
from dohyo.sumo_networks.parking.rules import Outcome
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
            body = self.world.episodes.karts[lot, number]
            actions[row] = self._experts[row].act(body, scene_of(self.world, lot, number))
        return actions, rows.copy()

    def _begin_seeded(self, rows: IntArray, seeds: Sequence[int | None], options: Mapping[str, Any]) -> None:
        super()._begin_seeded(rows, seeds, options)
        for row in rows.tolist():
            self._experts[row] = Expert()


def scene_of(world: ParkingWorld, lot: int, number: int) -> Scene:
    """What the expert of a kart sees."""
    there, episodes = world.scenery, world.episodes
    walls = wall_boxes(there.walls[lot, : there.wall_count[lot]])
    boxes = there.boxes[lot, : there.box_count[lot]]
    karts = [_kart(episodes.karts[lot, other]) for other in _others(episodes.outcome[lot], number)]
    walkers = [
        _walker(there.walkers[lot, walker], float(episodes.walked_m[lot, walker]))
        for walker in range(there.walker_count[lot])
    ]
    spot = there.spots[lot, episodes.target[lot, number]]
    return Scene(np.concatenate([walls, boxes]), np.array([*karts, *walkers]).reshape(-1, 7), spot)


def _others(outcomes: IntArray, number: int) -> list[int]:
    return [other for other in np.flatnonzero(outcomes != Outcome.ABSENT).tolist() if other != number]


def _kart(body: FloatArray) -> FloatArray:
    """(7,) box and velocity of a kart."""
    heading, speed = body[kart.HEADING], body[kart.SPEED]
    box = [body[kart.X], body[kart.Y], heading, kart.LENGTH_M, kart.WIDTH_M]
    return np.array([*box, speed * np.cos(heading), speed * np.sin(heading)])


def _walker(row: FloatArray, walked: float) -> FloatArray:
    """(7,) box and velocity of a pedestrian (6,) that has walked a way [m]."""
    (x, y), (then_x, then_y) = walker_place(row, walked), walker_place(row, walked + 0.1 * row[4])
    return np.array([x, y, 0.0, 2.0 * row[5], 2.0 * row[5], (then_x - x) / 0.1, (then_y - y) / 0.1])
