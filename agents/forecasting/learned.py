"""Forecasters with networks: training, torch, and export to ONNX."""

from __future__ import annotations

import io
import json
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from torch import nn

from dohyo.agents.forecasting.base import Forecaster, Progress, checked
from dohyo.agents.forecasting.data.scale import InMetres, Scale
from dohyo.agents.forecasting.data.windows import HISTORY, Windows
from dohyo.agents.forecasting.networks.registry import make_network
from dohyo.agents.forecasting.training import TrainSettings, train_network
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

OPSET = 17
BLOCK = 2048


@contextmanager
def in_double(network: nn.Module) -> Iterator[None]:
    """Inference in double precision on one thread meanwhile; to single precision and back no weight changes.

    In single precision the last digits of a forecast depend on the processor, so that a record's hash would not verify
    on another one. In double precision they lie far below what `Forecaster.predict` rounds to.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    network.double()
    try:
        with torch.inference_mode():
            yield
    finally:
        network.float()
        torch.set_num_threads(threads)


class Learned(Forecaster):
    """A network of `networks.registry`.

    Attributes:
        network: The network.
        settings: Of the training.
        scale: Standardisation of its input.
    """

    name: ClassVar[str] = "network"

    def __init__(self, kind: str, segments: int, step_s: float = 60.0, settings: TrainSettings | None = None) -> None:
        super().__init__(segments, step_s)
        self.settings = settings or TrainSettings()
        torch.manual_seed(self.settings.seed)  # of the first weights
        self.scale = Scale()
        self.kind, self.network = kind, make_network(kind, segments).eval()

    def learn(self, train: Windows, validation: Windows, progress: Progress | None) -> None:
        """Trains the network."""
        self.scale = Scale.of(train)
        train_network(self.network, train, validation, self.scale, self.free_mps, self.settings, progress)

    def predict_many(self, histories: Float32Array, time_s: FloatArray | None = None) -> Float32Array:
        """See `Forecaster.predict_many`."""
        with in_double(self.network):
            parts = torch.split(self.scale.standard(histories).double(), BLOCK)
            return self.scale.metres(torch.cat([self.network(some) for some in parts]))

    def tensors(self) -> dict[str, np.ndarray]:
        """See `Forecaster.tensors`."""
        return {name: tensor.numpy() for name, tensor in self.network.state_dict().items()}

    def restore(self, tensors: Mapping[str, np.ndarray]) -> None:
        """See `Forecaster.restore`."""
        checked(tensors, {name: tuple(t.shape) for name, t in self.network.state_dict().items()}, self.kind)
        self.network.load_state_dict({name: torch.from_numpy(array) for name, array in tensors.items()})

    def facts(self) -> dict[str, str]:
        """See `Forecaster.facts`."""
        own = {"forecaster": self.kind, "settings": json.dumps(asdict(self.settings))}
        return super().facts() | own | self.scale.facts()

    def export(self, path: Path) -> None:
        """Writes an ONNX model: `history` (8, N), m/s, without gaps, to `forecast` (3, N), m/s.

        Raises:
            InvalidInputError: It cannot be written.
        """
        write_onnx(InMetres(self.network, self.scale), self.segments, path)


def write_onnx(module: nn.Module, segments: int, path: Path) -> None:
    """Exports a module with one input `history` (8, N) and one output `forecast`.

    Raises:
        InvalidInputError: It cannot be written.
    """
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the tracing exporter is deprecated, the other one needs onnxscript
        torch.onnx.export(
            module.eval(),
            (torch.zeros(HISTORY, segments),),
            buffer,  # type: ignore[arg-type]
            input_names=["history"],
            output_names=["forecast"],
            opset_version=OPSET,
            dynamo=False,
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, buffer.getvalue())
    except OSError as error:
        raise InvalidInputError(f"cannot write '{path}': {error.strerror}") from error
