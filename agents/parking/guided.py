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
from dohyo.sumo_networks.parking.observation import State
from dohyo.sumo_networks.parking.rules import Outcome
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
    walls, boxes = wall_boxes(view.walls), view.boxes[:, :5]
    karts = [_kart(view.karts[other]) for other in _others(view.counts[:, OUTCOME], number)]
    walkers = [_walker(row) for row in view.walkers]
    spot = view.spots[view.counts[number, TARGET], :5]
    return Scene(np.concatenate([walls, boxes]), np.array([*karts, *walkers]).reshape(-1, 7), spot)


def _others(outcomes: IntArray, number: int) -> list[int]:
    return [other for other in np.flatnonzero(outcomes != Outcome.ABSENT).tolist() if other != number]


def _kart(body: FloatArray) -> FloatArray:
    """(7,) box and velocity of a kart."""
    heading, speed = body[kart.HEADING], body[kart.SPEED]
    box = [body[kart.X], body[kart.Y], heading, kart.LENGTH_M, kart.WIDTH_M]
    return np.array([*box, speed * np.cos(heading), speed * np.sin(heading)])


def _walker(row: FloatArray) -> FloatArray:
    """(7,) box and velocity of a pedestrian, a row of (P, 9)."""
    there = row[2:4] - row[:2]
    length = float(np.hypot(*there))
    if length == 0.0:
        return np.array([row[WALK_X], row[WALK_Y], 0.0, 2.0 * row[WALK_RADIUS], 2.0 * row[WALK_RADIUS], 0.0, 0.0])
    back = -1.0 if row[WALKED] % (2.0 * length) >= length else 1.0
    velocity = back * row[WALK_SPEED] * there / length
    return np.array([row[WALK_X], row[WALK_Y], 0.0, 2.0 * row[WALK_RADIUS], 2.0 * row[WALK_RADIUS], *velocity])
