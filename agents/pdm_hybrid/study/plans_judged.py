"""Plans judged: how far the plans of an episode are from what its egos drove."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from dohyo.agents.mcts.predictors.dataset import Sample
from dohyo.agents.pdm_hybrid.plans import POSE_S, POSES
from dohyo.agents.planning.scene import Scene
from dohyo.agents.studies.rows import Row
from dohyo.evaluation.scores.nuplan.open_loop import open_loop_score
from dohyo.sumo_networks.arrays import FloatArray

Plan = Callable[[Scene], FloatArray]
"""A scene -> (16, 3) x, y [m], heading [rad] in 0.5, 1.0, ..., 8 s."""
_SECOND = round(1.0 / POSE_S)
SAME_M, SAME_S = 0.05, 0.01


def constant_velocity(scene: Scene) -> FloatArray:
    """(16, 3) the ego keeps speed and heading."""
    plan = np.zeros((POSES, 3))
    plan[:, 0] = scene.ego.speed * POSE_S * np.arange(1, POSES + 1)
    return plan


def drives_of(samples: Sequence[Sample]) -> list[list[Sample]]:
    """The samples of each ego, in the order of time: the next one is where this one's future begins."""
    drives = list[list[Sample]]()
    for sample in samples:
        for drive in drives:
            if _follows(drive[-1], sample):
                drive.append(sample)
                break
        else:
            drives.append([sample])
    return drives


def _follows(before: Sample, after: Sample) -> bool:
    """Whether the ego of one sample is that of another one, half a second later."""
    if abs(after.scene.time - before.scene.time - POSE_S) > SAME_S:
        return False
    (x, y, heading), (dx, dy, _) = before.scene.pose, before.ego_future[0]
    cos, sin = np.cos(heading), np.sin(heading)
    there = np.array([x + dx * cos - dy * sin, y + dx * sin + dy * cos])
    return bool(np.hypot(*(there - after.scene.pose[:2])) < SAME_M)


def judged(drives: Sequence[Sequence[Sample]], plan: Plan) -> Row:
    """Measures of an episode, each the mean over its drives; a plan every second."""
    scores, distances = list[float](), list[FloatArray]()
    for drive in drives:
        asked = drive[::_SECOND]
        planned = np.array([plan(sample.scene) for sample in asked], np.float64)
        driven = np.array([sample.ego_future for sample in asked], np.float64)
        scores.append(open_loop_score(planned[:, _SECOND - 1 :: _SECOND], driven[:, _SECOND - 1 :: _SECOND]))
        distances.append(np.linalg.norm(planned[..., :2] - driven[..., :2], axis=-1).mean(axis=0))
    far = np.mean(distances, axis=0)
    return {
        "open_loop_score": round(float(np.mean(scores)), 3),
        "ade_m": round(float(far.mean()), 4),
        **{f"fde_{seconds}s_m": round(float(far[seconds * _SECOND - 1]), 4) for seconds in (2, 3, 5, 8)},
        "drives": len(drives),
        "plans": sum(len(drive[::_SECOND]) for drive in drives),
    }
