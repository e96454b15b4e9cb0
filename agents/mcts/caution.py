"""Caution: forecasts are changed so that actors ahead in the ego's lane do not clear it early.

A leader that has just braked is predicted to speed up again, as most drivers do; the ego would hit one that does not.
So leaders keep their speed at most, and those that brake go on for a second. Pedestrians walk straight on at their
speed, and leave the lane a second later, since they may stop in it. A vehicle's forecast keeps its shape, and is only
driven more slowly. Ours; the thesis uses predictions as they are.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dohyo.agents.mcts.predictors.constant_velocity import roll
from dohyo.agents.planning.braking import decelerations
from dohyo.agents.planning.motion import DT, project
from dohyo.agents.planning.scene import Scene
from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.world import ActorKind

LANE_SHARE = 0.5
"""Share of a lane's width from its middle within which an actor counts as ahead in it."""
SAME_WAY = 0.7
BRAKING_S, HESITATION_S = 1.0, 1.0


def cautious(scene: Scene, forecast: FloatArray) -> FloatArray:
    """Forecast with pedestrians at constant velocity, and leaders held back.

    Args:
        scene: Of the forecast.
        forecast: (N, 81, 3) x, y [m], heading [rad] of its actors.

    Returns:
        The changed forecast: a copy if there is a leader or a pedestrian, else the same array.
    """
    actors, p = scene.actors, scene.path
    path = np.column_stack([p.position, np.cos(p.heading), np.sin(p.heading)])
    spacing = float(p.s[-1] - p.s[0]) / (len(p.s) - 1)
    on_foot = actors.kind == ActorKind.PEDESTRIAN
    out = None
    if on_foot.any():
        out = forecast.copy()
        out[on_foot, 1:] = _walking_on(scene, on_foot)
    braking = decelerations(actors)
    for n in np.flatnonzero((actors.kind != ActorKind.STATIC) & (actors.position[:, 0] > 0.0)).tolist():
        x, y = (float(v) for v in actors.position[n])
        s, side, row = project(path, float(p.s[0]), spacing, x, y, 0.0, 1e6)
        turn = actors.heading[n] - p.heading[row]
        leads = on_foot[n] or math.cos(turn) > SAME_WAY
        if s > 0.0 and abs(side) < LANE_SHARE * p.width[row] and leads:
            out = forecast.copy() if out is None else out
            _hold_back(out[n], float(actors.speed[n]), float(braking[n]), HESITATION_S if on_foot[n] else 0.0)
    return forecast if out is None else out


def _walking_on(scene: Scene, on_foot: BoolArray) -> FloatArray:
    """(M, 80, 3) pedestrians at constant velocity, from 0.1 s on."""
    still = np.zeros(np.count_nonzero(on_foot))
    return roll(scene.actors.history[on_foot, -1], scene.actors.speed[on_foot], still, still)[:, 1:]


@njit(cache=True, error_model="numpy")
def _hold_back(poses: FloatArray, speed: float, braking: float, wait: float) -> None:
    """Slows (81, 3) poses down: speed limit [m/s], deceleration [m/s^2] for a second, after a wait [s]."""
    before = poses.copy()
    travelled, allowed, k, passed = 0.0, 0.0, 0, 0.0
    length = math.hypot(before[1, 0] - before[0, 0], before[1, 1] - before[0, 1])
    for i in range(1, before.shape[0]):
        travelled += math.hypot(before[i, 0] - before[i - 1, 0], before[i, 1] - before[i - 1, 1])
        if (i - 1) * DT < BRAKING_S:
            speed = max(speed - braking * DT, 0.0)
        if (i - 1) * DT >= wait:
            allowed = min(allowed + speed * DT, travelled)
        while passed + length < allowed and k < before.shape[0] - 2:
            k, passed = k + 1, passed + length
            length = math.hypot(before[k + 1, 0] - before[k, 0], before[k + 1, 1] - before[k, 1])
        share = min((allowed - passed) / length, 1.0) if length > 0.0 else 0.0
        poses[i, 0] = before[k, 0] + share * (before[k + 1, 0] - before[k, 0])
        poses[i, 1] = before[k, 1] + share * (before[k + 1, 1] - before[k, 1])
        poses[i, 2] = before[k + 1, 2] if share > 0.5 else before[k, 2]
