"""OnnxForecaster: an uploaded ONNX model as a forecaster."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np

from dohyo.agents.forecasting.agent import HISTORY_SENSOR, ForecasterSpec
from dohyo.evaluation.settings import FieldsOf
from dohyo.service.policies.of_family import OnnxAgent, PolicyFile


class OnnxForecaster(OnnxAgent[ForecasterSpec]):
    """Forecasts with a model of `history` (8, N) alone; see `ForecastAgent`."""

    def __init__(self, sha256: str = "", name: str = "onnx", **file: Annotated[Any, FieldsOf(PolicyFile)]) -> None:
        """Reads the model; the process starts at `reset`.

        Args:
            sha256: Hash of the model; optional where `path` or `content` is given.
            name: Name of the agent.
            file: See `PolicyFile`.

        Raises:
            InvalidInputError: The model is missing, has another hash, or was refused by the checks.
        """
        super().__init__(ForecasterSpec(name=name, sensors=(HISTORY_SENSOR,)), sha256, PolicyFile(**file))

    def act(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """See `ForecastAgent`.

        Raises:
            AgentError: The model failed; AgentTimeoutError: it did not answer in time.
        """
        return self._policy.act(dict(observation))
