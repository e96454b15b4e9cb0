"""OnnxForecaster: an uploaded ONNX model as a forecaster."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dohyo.agents.forecasting.agent import HISTORY_SENSOR, ForecasterSpec
from dohyo.evaluation.families import FORECASTING_CONTROL
from dohyo.service.forecasting.interface import TRACK
from dohyo.service.policies.agent import OnnxPolicy
from dohyo.service.policies.limits import PolicyLimits


class OnnxForecaster:
    """Forecasts with a model of `history` (8, N) alone; see `OnnxPolicy`, which has the checks and the sandbox.

    Attributes:
        spec: See `ForecastAgent`.
        sha256: Hash of the model.
    """

    def __init__(
        self,
        sha256: str = "",
        name: str = "onnx",
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
            onnxruntime: The version it was submitted for; "": whichever is here.
            path: A local file, which is checked first.
            content: Content of such a file.
            limits: Resources that the model may use.

        Raises:
            InvalidInputError: The model is missing, has another hash, or was refused by the checks.
        """
        self.spec = ForecasterSpec(name=name, sensors=(HISTORY_SENSOR,))
        self._policy = OnnxPolicy(
            *(sha256, name, TRACK, self.spec.sensors, FORECASTING_CONTROL),
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
        return {key: of_policy[key] for key in ("sha256", "name", "onnxruntime")}

    def reset(self, seed: int) -> None:
        """Starts a new process: states are zero, random operators draw from the seed."""
        self._policy.start(seed)

    def act(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """See `ForecastAgent`.

        Raises:
            AgentError: The model failed; AgentTimeoutError: it did not answer in time.
        """
        return self._policy.act(dict(observation))

    def close(self) -> None:
        """Ends the process."""
        self._policy.close()
