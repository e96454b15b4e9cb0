"""Forecaster in ONNX Runtime, on one thread, for planners and workers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar, Never

import numpy as np

from dohyo.agents.forecasting.base import Forecaster, Progress
from dohyo.agents.forecasting.data.windows import HISTORY, Windows
from dohyo.agents.learning.policies.session import session_from
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.errors import InvalidInputError


class Exported(Forecaster):
    """A model with the input `history` (8, N) and the output `forecast`, both m/s.

    Attributes:
        session: The model.
    """

    name: ClassVar[str] = "onnx"

    def __init__(self, path: Path, step_s: float = 60.0) -> None:
        self.session = session_from(path, "forecaster")
        inputs = {one.name: tuple(one.shape) for one in self.session.get_inputs()}
        if set(inputs) != {"history"} or len(inputs["history"]) != 2 or inputs["history"][0] != HISTORY:
            raise InvalidInputError(
                f"'{path}' is no forecaster: expected the input history ({HISTORY}, N), got {inputs}"
            )
        super().__init__(int(inputs["history"][1]), step_s)
        self.path = path

    def predict_many(self, histories: Float32Array, time_s: FloatArray | None = None) -> Float32Array:
        """See `Forecaster.predict_many`."""
        return np.stack([self._middle(self.session.run(None, {"history": one})[0]) for one in histories])

    @staticmethod
    def _middle(out: Float32Array) -> Float32Array:
        """(3, N), also of a model that gives intervals (3, 3, N)."""
        return out if out.ndim == 2 else out[:, 1]

    def learn(self, train: Windows, validation: Windows, progress: Progress | None) -> Never:
        """Refused: an exported model cannot be trained."""
        raise InvalidInputError(f"'{self.path}' is exported and cannot be trained; train its safetensors file")

    def tensors(self) -> Never:
        """Refused: an exported model is a file already."""
        raise InvalidInputError(f"'{self.path}' is exported and cannot be saved again")

    def restore(self, tensors: Mapping[str, np.ndarray]) -> Never:
        """See `tensors`."""
        raise InvalidInputError(f"'{self.path}' is exported and takes no tensors")
