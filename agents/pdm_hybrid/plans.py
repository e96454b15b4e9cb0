"""Plans: PDM-Closed's next 8 s in a scene, and what a network sees of scene and plan.

PDM-Closed judges its proposals over 4 s; the plan is the chosen one, rolled out for 8 s.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
from gymnasium.spaces import Box, Dict

from dohyo.agents.experts.pdm import CORRIDOR_MARGIN_M, LEEWAY_S, LINE_GAP_M, PdmClosed
from dohyo.agents.experts.proposals import (
    CENTRE_X,
    CENTRE_Y,
    HEADING,
    PROPOSALS,
    STATE,
    STEPS,
    roll_out,
    score,
)
from dohyo.agents.planning.motion import Idm
from dohyo.agents.planning.scene import HISTORY, Scene
from dohyo.agents.planning.situation import Situation
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import Float32Array, FloatArray

POSES, POSE_S = 16, 0.5
"""Poses of a plan: their number, and the time between two."""
_STRIDE: Final = 5
CENTRELINE, CENTRELINE_M = 60, 2
"""Points of the centreline ahead, and the distance between two, m."""
PATH, MOTION, PLAN = "path", "motion", "plan"
MOTION_NUMBERS: Final = 4 * HISTORY
LENGTH_UNIT, SPEED_UNIT = 20.0, 10.0
SPACE: Final = Dict(
    {
        name: Box(-np.inf, np.inf, (size,), np.float32)
        for name, size in {MOTION: MOTION_NUMBERS, PATH: 2 * CENTRELINE, PLAN: 3 * POSES}.items()
    }
)
"""Inputs of the network; names are sorted, as gymnasium sorts them."""
SIZES: Final[Mapping[str, int]] = MappingProxyType({name: int(one.shape[0]) for name, one in SPACE.spaces.items()})  # type: ignore[index]
Variant = Literal["careful", "published"]


class Planner(PdmClosed):
    """PDM-Closed with its plan for 8 s; it drives as PDM-Closed does."""

    def __init__(self, variant: Variant = "careful", passing: bool = True, looks_ahead: bool = True) -> None:
        """See `PdmClosed`."""
        super().__init__(variant, passing, looks_ahead)
        self._long = np.zeros((PROPOSALS, POSES * _STRIDE + 1, STATE))
        self._seen: tuple[Scene, Situation, Idm] | None = None

    def _look(self, observation: Observation, scene: Scene) -> tuple[Situation, Idm]:
        road, model = super()._look(observation, scene)
        self._seen = scene, road, model
        return road, model

    def plan(self) -> FloatArray:
        """(16, 3) poses of the last decision's plan, see `plan_in`."""
        assert self._seen is not None, "after a decision"
        poses: FloatArray = self._rolled(*self._seen)[self._chosen]
        return poses

    def plan_in(self, scene: Scene) -> FloatArray:
        """(16, 3) x, y [m], heading [rad] in 0.5, 1.0, ..., 8 s of the plan in a scene, in its frame.

        It goes round nothing, since a scene does not hold what that needs.
        """
        road, model = PdmClosed._look(self, {}, scene)
        poses = self._rolled(scene, road, model)
        states = np.ascontiguousarray(self._long[:, : STEPS + 1])
        score(road, self._car, states, self._scores, LEEWAY_S if self._careful else 0.0)
        chosen: FloatArray = poses[self._best()]
        return chosen

    def _rolled(self, scene: Scene, road: Situation, model: Idm) -> FloatArray:
        """(15, 16, 3) poses of every proposal."""
        ego, start = scene.ego, np.zeros(STATE)
        start[:6] = -self._car.axle, 0.0, 0.0, ego.speed, ego.acceleration, ego.steering
        roll_out(road, self._car, model, LINE_GAP_M, CORRIDOR_MARGIN_M, start, self._long, self._careful)
        return self._long[:, _STRIDE::_STRIDE, [CENTRE_X, CENTRE_Y, HEADING]]


def make_planner() -> Planner:
    """The planner of plans in scenes, which its network was trained beside."""
    return Planner(passing=False, looks_ahead=False)  # type: ignore[abstract]


def inputs(scene: Scene, plan: FloatArray) -> dict[str, Float32Array]:
    """Inputs of the network.

    Args:
        scene: The scene.
        plan: (16, 3) of PDM-Closed.

    Returns:
        path (120,): x, y of 60 points of the centreline, 2 m apart, in 20 m. motion (16,): the last four poses, and
        speed, acceleration, yaw rate and steering. plan (48,): its poses.
    """
    ego, path = scene.ego, scene.path
    first = int(np.searchsorted(path.s, 0.0))
    rows = np.minimum(first + CENTRELINE_M * np.arange(CENTRELINE), len(path.s) - 1)
    now = ego.speed / SPEED_UNIT, ego.acceleration / SPEED_UNIT, ego.yaw_rate, ego.steering
    found = {
        PATH: path.position[rows] / LENGTH_UNIT,
        MOTION: np.concatenate([(ego.history / (SPEED_UNIT, SPEED_UNIT, 1.0)).ravel(), now]),
        PLAN: plan / (LENGTH_UNIT, LENGTH_UNIT, 1.0),
    }
    return {name: np.asarray(array, np.float32).ravel() for name, array in found.items()}
