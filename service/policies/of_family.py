"""Base of the ONNX agents of families that give their agents no mission: forecasting and parking."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Literal, Protocol, TypeVar

from dohyo.service.policies.agent import OnnxPolicy
from dohyo.service.policies.limits import PolicyLimits


class Spec(Protocol):
    """Specification of an agent of any family."""

    @property
    def name(self) -> str:
        """Name of the agent."""

    @property
    def track(self) -> Literal["sensors", "map", "privileged"]:
        """Track of the agent."""

    @property
    def sensors(self) -> tuple[str, ...]:
        """Inputs of the model."""

    @property
    def control(self) -> str:
        """Control interface of the model's output."""


S = TypeVar("S", bound=Spec)


@dataclass(frozen=True)
class PolicyFile:
    """Arguments of `OnnxPolicy` that say where its model is, and how it may run.

    Attributes:
        onnxruntime: The version it was submitted for; "": whichever is here.
        path: A local file, which is checked first.
        content: Content of such a file.
        limits: Resources that the model may use.
    """

    onnxruntime: str = ""
    path: str | Path | None = None
    content: bytes | None = None
    limits: PolicyLimits | None = None


class OnnxAgent(Generic[S]):
    """An `OnnxPolicy`, which has the checks and the sandbox, as an agent of another family.

    Attributes:
        spec: Specification of the agent.
        sha256: Hash of the model.
    """

    def __init__(self, spec: S, sha256: str, file: PolicyFile) -> None:
        """Reads the model; the process starts at `reset`.

        Raises:
            InvalidInputError: The model is missing, has another hash, or was refused by the checks.
        """
        self.spec = spec
        self._policy = OnnxPolicy(sha256, spec.name, spec.track, spec.sensors, spec.control, **vars(file))
        self.sha256 = self._policy.sha256

    @property
    def settings(self) -> dict[str, Any]:
        """Constructor arguments that build the same agent on any machine."""
        of_policy = self._policy.settings
        return {key: of_policy[key] for key in ("sha256", "name", "onnxruntime")}

    def reset(self, seed: int) -> None:
        """Starts a new process: states are zero; see `OnnxPolicy.start`."""
        self._policy.start()

    def close(self) -> None:
        """Ends the process."""
        self._policy.close()
