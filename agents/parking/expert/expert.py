"""Expert: plans a way into a kart's spot, drives it, waits for what walks or drives across, and plans anew.

It sees the whole lot, as the thesis's human demonstrators do. Plans are forwards only by default, since the reward of
the thesis ends an episode at a negative torque; every kind of spot can be entered so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit

from dohyo.agents.parking.expert.curves import poses_along
from dohyo.agents.parking.expert.hybrid_a_star import SAMPLE_M, Shape, plan, touches
from dohyo.agents.parking.expert.scene import Scene
from dohyo.agents.parking.expert.shortest import shortest_curve
from dohyo.agents.parking.expert.tracker import AXLE_M, follow, rear_axle
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.parking import kart

RADIUS_M: Final = 2.2
"""Turning radius of the plans; the tightest one is 1.8 m, and the difference is left to the tracker."""
SHAPE: Final = Shape(RADIUS_M, 0.5 * kart.LENGTH_M + AXLE_M, 0.5 * kart.LENGTH_M - AXLE_M, 0.5 * kart.WIDTH_M)
MARGINS_M: Final = (0.35, 0.2, 0.08)
"""Margins of the kart in a plan, the first that has a path."""
EXPANSIONS: Final = 3000
STUCK_S: Final = 2.0
"""Time of standing before something that moves, after which the expert plans around it."""
PATIENCE_S: Final = 1.5
"""Time for which what moves is expected to go on as it does."""
BRAKING_MPS2: Final = 1.2


@dataclass
class Expert:
    """Driver of one kart for one episode.

    Attributes:
        reverse: Whether its plans may go backwards.
        path: (P, 5) of the rear axle; empty: none was found.
    """

    reverse: bool = False

    def __post_init__(self) -> None:
        """Begins without a plan."""
        self.path: FloatArray = np.zeros((0, 5))
        self._at, self._waited_s = 0, 0.0
        self._spot: FloatArray = np.full(5, np.nan)

    def act(self, body: FloatArray, scene: Scene) -> FloatArray:
        """(3,) action of a kart (7,)."""
        if not np.array_equal(self._spot, scene.spot):
            self._plan(body, scene, scene.fixed)
        elif self._waited_s > STUCK_S:
            self._plan(body, scene, np.concatenate([scene.fixed, scene.moving[:, :5]]))
        if not len(self.path):
            return np.array([0.0, 0.0, 1.0])
        free = free_way(body, self.path, self._at, scene.moving, SHAPE)
        action, self._at = follow(body, self.path, self._at, RADIUS_M, free)
        blocked = free < math.inf and abs(body[kart.SPEED]) < 0.1
        self._waited_s = self._waited_s + kart.TICK_S if blocked else 0.0
        return action

    def _plan(self, body: FloatArray, scene: Scene, boxes: FloatArray) -> None:
        """Plans with the widest margin that has a path; keeps the old path without one."""
        start, goal = rear_axle(body), goal_in(scene.spot)
        self._waited_s = 0.0
        fresh = not np.array_equal(self._spot, scene.spot)
        self._spot = scene.spot.copy()
        for margin in MARGINS_M:
            path = plan(start, goal, boxes, SHAPE.padded(margin), self.reverse, EXPANSIONS)
            if len(path):
                self.path, self._at = path, 0
                return
        if fresh:  # rather a bold way than none
            curve = shortest_curve(start, goal, RADIUS_M, reverse=False)[1]
            self.path, self._at = poses_along(start, curve, RADIUS_M, SAMPLE_M), 0


def goal_in(spot: FloatArray) -> FloatArray:
    """(3,) pose of the rear axle of a kart in the middle of a spot (5,)."""
    return np.array([spot[0] - AXLE_M * math.cos(spot[2]), spot[1] - AXLE_M * math.sin(spot[2]), spot[2]])


@njit(cache=True)
def free_way(body: FloatArray, path: FloatArray, at: int, moving: FloatArray, shape: Shape) -> float:
    """Way on a path before something that moves, less a margin, m; infinite: nothing is in the way.

    Args:
        body: (7,) state of the kart.
        path: (P, 5) of its rear axle.
        at: Index of the kart on it.
        moving: (M, 7) boxes with velocities.
        shape: Of the kart.
    """
    speed = abs(body[kart.SPEED])
    horizon, way = speed * speed / (2.0 * BRAKING_MPS2) + 2.5, 0.0
    padded, there = Shape(shape.radius, shape.front + 0.5, shape.rear, shape.half_width + 0.4), np.empty((1, 5))
    for i in range(at, len(path)):
        if i > at:
            way += math.hypot(path[i, 0] - path[i - 1, 0], path[i, 1] - path[i - 1, 1])
        if way > horizon:
            break
        arrival = min(way / max(speed, 0.7), PATIENCE_S)
        for j in range(len(moving)):
            for when in (0.0, arrival):
                there[0] = moving[j, :5]
                there[0, 0] += when * moving[j, 5]
                there[0, 1] += when * moving[j, 6]
                if touches(path[i, 0], path[i, 1], path[i, 2], padded, there):
                    return max(way - 0.5, 0.0)
    return math.inf
