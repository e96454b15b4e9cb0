"""Offset: the trained network in onnxruntime, which corrects a plan beyond its first seconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dohyo.agents.learning.policies.session import session_from
from dohyo.agents.pdm_hybrid.plans import POSE_S, POSES, SIZES, inputs
from dohyo.agents.planning.scene import Scene
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError

SHIPPED = Path(__file__).with_name("checkpoints") / "pdm-hybrid.onnx"
KEPT_S = 2.0
"""Of a plan, which no offset changes. Source: Dauner et al. 2023."""


class Offset:
    """Correction of plans."""

    def __init__(self, path: str | Path = SHIPPED, kept_s: float = KEPT_S) -> None:
        """Reads a network.

        Args:
            path: ONNX file of a training of `pdm-offset`.
            kept_s: Time up to which the plan stays as it is, s.

        Raises:
            InvalidInputError: There is no such network.
        """
        self._session = session_from(Path(path), "offset")
        told = {one.name: tuple(one.shape[1:]) for one in self._session.get_inputs()}
        known = {name: (size,) for name, size in SIZES.items() if name in told}
        if not told or told != known:
            raise InvalidInputError(f"'{path}' is no offset of plans: expected inputs of {SIZES}, got {told}")
        self._names = list(told)
        self._corrected = POSE_S * np.arange(1, POSES + 1) > kept_s + 1e-9

    def __call__(self, scene: Scene, plan: FloatArray) -> FloatArray:
        """(16, 3) a plan and its correction, see `plans.Planner.plan_in`."""
        seen = inputs(scene, plan)
        poses = self._session.run(None, {name: seen[name][None] for name in self._names})[0][0]
        return np.where(self._corrected[:, None], poses.astype(np.float64), plan)
