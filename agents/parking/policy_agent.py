"""A trained policy as an agent of the parking benchmarks."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.learning.tasks.task import SINGLE, named
from dohyo.evaluation.parking.agent import ParkingSpec
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.parking.observation import observation_space

CHECKPOINTS: Final = Path(__file__).with_name("checkpoints")
ONE, THREE = "one", "three"
SHIPPED: Final = {ONE: CHECKPOINTS / "parking.onnx", THREE: CHECKPOINTS / "three.onnx"}
"""Policies that come with dohyo, trained alone in a lot or beside two others."""


class PolicyAgent:
    """What `dohyo train parking` exported; it sees the observation of its kart alone.

    Attributes:
        spec: See `ParkingAgent`.
        files: The policy, whose digest records state.
    """

    def __init__(self, policy: Path = Path(ONE)) -> None:
        """Reads the policy.

        Args:
            policy: ONNX file of a training, such as its best.onnx; or "one" or "three", those that come with dohyo.

        Raises:
            InvalidInputError: The file is missing, or no policy of a kart's observation.
        """
        path = SHIPPED.get(str(policy), Path(policy))
        self.spec, self.files = ParkingSpec(name="parking"), (path,)
        self._policy = OnnxPolicy(path)
        self._policy.check(named(observation_space(self.spec.state)))

    def reset(self, seed: int) -> None:
        """See `ParkingAgent`."""

    def act(self, observation: Float32Array) -> Float32Array:
        """See `ParkingAgent`."""
        return self._policy({SINGLE: observation})

    def close(self) -> None:
        """See `ParkingAgent`."""
