"""OnnxPolicy: an uploaded ONNX model as an agent."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dohyo.evaluation.agent import Agent, AgentSpec, Mission, Observation
from dohyo.service.policies.checks import check_policy
from dohyo.service.policies.interface import expected_action, expected_inputs
from dohyo.service.policies.limits import PolicyLimits
from dohyo.service.policies.sandbox import Sandbox
from dohyo.sumo_networks.errors import AgentError, InvalidInputError

ENTRY = "dohyo.service.policies.agent:OnnxPolicy"
NAME = "onnx"
"""Name on the command line of an agent that is an ONNX file: `--agent onnx --set path=FILE`."""
FOLDER_VARIABLE = "DOHYO_POLICIES"
SHA256 = re.compile(r"[0-9a-f]{64}")


class OnnxPolicy(Agent):
    """Drives with the model's actions; every episode runs in a new sandboxed process.

    A record must not depend on where files lie: an evaluation names the model by its hash alone, and it is found as
    $DOHYO_POLICIES/HASH.onnx, where only files that passed `check_policy` are kept.

    Attributes:
        sha256: Hash of the model.
        limits: Resources that the model may use.
        settings: The constructor's arguments for the same agent anywhere, for records.
    """

    def __init__(
        self,
        sha256: str = "",
        name: str = "onnx",
        track: Literal["sensors", "map", "privileged"] = "map",
        sensors: Sequence[str] = ("speedometer", "route"),
        control: str = "target_speed_steering",
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
            track: Track of the agent.
            sensors: Inputs of the model.
            control: Control interface of the model's output.
            onnxruntime: The version it was submitted for, on which its last bits depend; "": whichever is here.
            path: A local file, which is checked first.
            content: Content of such a file.
            limits: Resources that the model may use.

        Raises:
            InvalidInputError: The model is missing, has another hash, or was refused by the checks.
        """
        self.spec = AgentSpec(name=name, track=track, sensors=tuple(sensors), control=control)
        self.limits = limits or PolicyLimits()
        self._inputs, self._action = expected_inputs(self.spec), expected_action(self.spec)
        self._runtime = version("onnxruntime")
        if onnxruntime not in ("", self._runtime):
            raise InvalidInputError(
                f"policy '{name}' was submitted for onnxruntime {onnxruntime}, here is {self._runtime}; submit it again"
            )
        own = path is not None or content is not None
        self._content = content if content is not None else _read(Path(path) if path is not None else _stored(sha256))
        self.sha256 = hashlib.sha256(self._content).hexdigest()
        if sha256 not in ("", self.sha256):
            raise InvalidInputError(f"policy '{name}': expected a file with sha256 {sha256}, got {self.sha256}")
        if own:
            check_policy(self._content, self.spec, self.limits)
        self._sandbox: Sandbox | None = None

    @property
    def settings(self) -> dict[str, Any]:
        """Constructor arguments that build the same agent on any machine."""
        spec = self.spec
        return {
            "sha256": self.sha256,
            "name": spec.name,
            "track": spec.track,
            "sensors": list(spec.sensors),
            "control": spec.control,
            "onnxruntime": self._runtime,
        }

    def reset(self, mission: Mission, seed: int) -> None:
        """Starts a new process: states are zero."""
        self.start()

    def start(self) -> None:
        """The same, for agents that have no mission.

        Random operators draw the same numbers in every episode. A model that knew a hidden scenario's seed could tell
        it by the time that it takes.
        """
        self.close()
        seed = int(self.sha256[:8], 16)
        self._sandbox = Sandbox(self._content, self._inputs, self.limits, seed, self._action.name)

    def act(self, observation: Observation) -> np.ndarray:
        """The model's action, without a leading batch dimension.

        Raises:
            AgentError: The model failed; AgentTimeoutError: it did not answer in time.
        """
        if self._sandbox is None:
            raise AgentError(f"policy '{self.spec.name}' was not reset")
        action = self._sandbox.decide(observation)
        return action[0] if action.shape == (1, *self._action.shape) else action

    def close(self) -> None:
        """Ends the process."""
        if self._sandbox is not None:
            self._sandbox.close()
            self._sandbox = None


def _stored(sha256: str) -> Path:
    """Path of a checked model."""
    if not SHA256.fullmatch(sha256):
        raise InvalidInputError(f"expected the sha256 of a policy, 64 hexadecimal digits, got '{sha256[:80]}'")
    folder = os.environ.get(FOLDER_VARIABLE)
    if not folder:
        raise InvalidInputError(f"policy {sha256[:12]}: {FOLDER_VARIABLE} must name the folder of uploaded policies")
    return Path(folder) / f"{sha256}.onnx"


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InvalidInputError(f"policy '{path.name}' cannot be read: {error.strerror}") from error
