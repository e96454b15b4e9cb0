"""OnnxParker: an uploaded ONNX model as an agent that parks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dohyo.evaluation.families import PARKING_CONTROL
from dohyo.evaluation.parking.agent import ParkingSpec
from dohyo.service.parking.interface import INPUT, TRACK
from dohyo.service.policies.agent import OnnxPolicy
from dohyo.service.policies.limits import PolicyLimits
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.parking.observation import State


class OnnxParker:
    """Parks one kart with the model's actions; see `OnnxPolicy`, which has the checks and the sandbox.

    Attributes:
        spec: See `ParkingAgent`.
        sha256: Hash of the model.
    """

    def __init__(
        self,
        sha256: str = "",
        name: str = "onnx",
        state: State = "oriented",
        *,
        onnxruntime: str = "",
        path: str | Path | None = None,
        content: bytes | None = None,
        limits: PolicyLimits | None = None,
    ) -> None:
        """Reads the model; the process starts at `reset`.

        Args:
            sha256: Hash of the model; optional where `path` or `content` is given.
            name: Name of the agent.
            state: Columns of the model's input.
            onnxruntime: The version it was submitted for; "": whichever is here.
            path: A local file, which is checked first.
            content: Content of such a file.
            limits: Resources that the model may use.

        Raises:
            InvalidInputError: The model is missing, has another hash, or was refused by the checks.
        """
        self.spec = ParkingSpec(name=name, state=state)
        self._policy = OnnxPolicy(
            *(sha256, name, TRACK, self.spec.sensors, PARKING_CONTROL),
            onnxruntime=onnxruntime,
            path=path,
            content=content,
            limits=limits,
        )
        self.sha256 = self._policy.sha256

    @property
    def settings(self) -> dict[str, Any]:
        """Constructor arguments that build the same agent on any machine."""
        of_policy = self._policy.settings
        return {key: of_policy[key] for key in ("sha256", "name", "onnxruntime")} | {"state": self.spec.state}

    def reset(self, seed: int) -> None:
        """Starts a new process: states are zero, random operators draw from the seed."""
        self._policy.start(seed)

    def act(self, observation: Float32Array) -> Float32Array:
        """See `ParkingAgent`.

        Raises:
            AgentError: The model failed; AgentTimeoutError: it did not answer in time.
        """
        return self._policy.act({INPUT: observation})

    def close(self) -> None:
        """Ends the process."""
        self._policy.close()
