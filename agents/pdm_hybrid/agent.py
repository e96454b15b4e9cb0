"""PDM-Hybrid: drives as PDM-Closed, and tells where it will be in 8 s as its demonstrator would.

The plan of a tick is PDM-Closed's for 2 s, then corrected by a network. What drives is the plan's beginning, so its
actions are PDM-Closed's; with `kept_s=0` the network's poses are driven instead, as by the learned planner alone.

Source: Dauner, Hallgarten, Geiger, Chitta, "Parting with Misconceptions about Learning-based Vehicle Motion Planning",
2023. Written from its description.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from dohyo.agents.learning.policies.trained import policy_file
from dohyo.agents.pdm_hybrid.offset import KEPT_S, SHIPPED, Offset
from dohyo.agents.pdm_hybrid.plans import POSE_S, Planner, Variant
from dohyo.agents.planning.scene import SENSORS
from dohyo.evaluation.agent import AgentSpec, Explanation, Observation
from dohyo.sumo_networks.ego.control import pure_pursuit
from dohyo.sumo_networks.errors import InvalidInputError

AIM_S: Final = 1.0
"""The pose that is driven towards where the network's poses are driven, s ahead."""
HARDEST, STRONGEST = -8.0, 2.4


class PdmHybrid(Planner):
    """The planner; see the module."""

    spec = AgentSpec(name="pdm-hybrid", track="privileged", sensors=SENSORS, control="acceleration_steering")

    def __init__(
        self,
        variant: Variant = "careful",
        passing: bool = True,
        looks_ahead: bool = True,
        policy: str | Path | None = None,
        kept_s: float = KEPT_S,
    ) -> None:
        """Reads the network.

        Args:
            variant: See `PdmClosed`.
            passing: See `PdmClosed`.
            looks_ahead: See `PdmClosed`.
            policy: ONNX file of a training of `pdm-offset`; None: the shipped one.
            kept_s: Time for which the plan is PDM-Closed's, from 0 to 8 s.

        Raises:
            InvalidInputError: There is no such network, or a setting is out of range.
        """
        super().__init__(variant, passing, looks_ahead)
        if not 0.0 <= kept_s <= 8.0:
            raise InvalidInputError(f"agent 'pdm-hybrid': expected kept_s from 0 to 8 s, got {kept_s:g}")
        path = policy_file(policy, SHIPPED, "pdm-offset")
        self._offset, self._drives_closed, self.files = Offset(path, kept_s), kept_s >= AIM_S, (path,)

    def act(self, observation: Observation) -> np.ndarray:
        """PDM-Closed's action; or towards the network's pose, unless PDM-Closed brakes in an emergency."""
        action = super().act(observation)
        if self._drives_closed or self._braking:
            return action
        assert self._seen is not None
        ego, aim = self._seen[0].ego, self._hybrid()[round(AIM_S / POSE_S) - 1]
        demand = 2.0 * (float(aim[0]) - ego.speed * AIM_S) / AIM_S**2
        wheel = pure_pursuit(self._vehicle, max(float(aim[0]), 0.1), float(aim[1])) if aim[0] > 1.0 else ego.steering
        return np.array([np.clip(demand, HARDEST, STRONGEST), np.clip(wheel / self._vehicle.max_steering, -1.0, 1.0)])

    def _hybrid(self) -> np.ndarray:
        """(16, 3) the present plan."""
        assert self._seen is not None
        return self._offset(self._seen[0], self.plan())

    def explain(self) -> Explanation | None:
        """What PDM-Closed tells, with the corrected plan every 0.5 s as its trajectory."""
        told = super().explain()
        if told is None:
            return None
        return {**told, "kept": told["trajectory"], "trajectory": self._hybrid()[:, :2].round(2).tolist()}
