"""OnnxParker: an uploaded ONNX model as an agent that parks."""

from __future__ import annotations

from typing import Annotated, Any

from dohyo.evaluation.parking.agent import ParkingSpec
from dohyo.evaluation.settings import FieldsOf
from dohyo.service.parking.interface import INPUT
from dohyo.service.policies.of_family import OnnxAgent, PolicyFile
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.parking.observation import State


class OnnxParker(OnnxAgent[ParkingSpec]):
    """Parks one kart with the model's actions; see `ParkingAgent`."""

    def __init__(
        self,
        sha256: str = "",
        name: str = "onnx",
        state: State = "oriented",
        **file: Annotated[Any, FieldsOf(PolicyFile)],
    ) -> None:
        """Reads the model; the process starts at `reset`.

        Args:
            sha256: Hash of the model; optional where `path` or `content` is given.
            name: Name of the agent.
            state: Columns of the model's input.
            file: See `PolicyFile`.

        Raises:
            InvalidInputError: The model is missing, has another hash, or was refused by the checks.
        """
        super().__init__(ParkingSpec(name=name, state=state), sha256, PolicyFile(**file))

    @property
    def settings(self) -> dict[str, Any]:
        """Constructor arguments that build the same agent on any machine."""
        return super().settings | {"state": self.spec.state}

    def act(self, observation: Float32Array) -> Float32Array:
        """See `ParkingAgent`.

        Raises:
            AgentError: The model failed; AgentTimeoutError: it did not answer in time.
        """
        return self._policy.act({INPUT: observation})
