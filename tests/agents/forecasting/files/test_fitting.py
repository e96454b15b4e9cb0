"""ONNX models of one's own: an open number of segments is bound, and what is no forecast is refused in words."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from dohyo.agents.forecasting.benchmark import forecaster_named
from dohyo.agents.forecasting.files.fitting import load_fitting
from dohyo.sumo_networks.errors import InvalidInputError

Model = Callable[[torch.Tensor], torch.Tensor]


class Network(torch.nn.Module):
    def __init__(self, function: Model) -> None:
        super().__init__()
        self.function = function

    def forward(self, history: torch.Tensor) -> torch.Tensor:
        return self.function(history)


def stays(history: torch.Tensor) -> torch.Tensor:
    return history[-1:].repeat(3, 1)


def write(path: Path, function: Model, segments: int, is_open: bool = False, kind: torch.dtype = torch.float32) -> str:
    axes = {"history": {1: "N"}, "forecast": {1: "N"}} if is_open else None
    names = {"input_names": ["history"], "output_names": ["forecast"], "dynamic_axes": axes}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        history = torch.zeros(8, segments, dtype=kind)
        torch.onnx.export(Network(function), (history,), str(path), opset_version=17, dynamo=False, **names)
    return str(path)


def test_a_model_that_leaves_its_width_open_is_one_of_the_road(tmp_path: Path) -> None:
    model = write(tmp_path / "m.onnx", stays, 2, is_open=True)
    forecaster, _ = forecaster_named(model, 21, {})
    assert forecaster.segments == 21
    np.testing.assert_allclose(forecaster.predict(np.full((8, 21), 12.5)), np.full((3, 21), 12.5))


def test_a_forecast_with_intervals_has_its_middle(tmp_path: Path) -> None:
    model = write(tmp_path / "m.onnx", lambda x: torch.stack([stays(x) - 1, stays(x), stays(x) + 1], dim=1), 4)
    np.testing.assert_allclose(load_fitting(model, 4).predict(np.full((8, 4), 12.5)), np.full((3, 4), 12.5))


@pytest.mark.parametrize(
    ("function", "kind", "message"),
    [
        (lambda x: stays(x)[None], torch.float32, r"expected a forecast \(3, 2\), or \(3, 3, 2\) .*got \(1, 3, 2\)"),
        (lambda x: x[-1:].repeat(2, 1), torch.float32, r"got \(2, 2\)"),
        (stays, torch.float64, r"fails on a history \(8, 2\) of float32: .*Unexpected input data type"),
    ],
)
def test_what_is_no_forecast_is_refused(tmp_path: Path, function: Model, kind: torch.dtype, message: str) -> None:
    model = write(tmp_path / "m.onnx", function, 2, kind=kind)
    with pytest.raises(InvalidInputError, match=message):
        load_fitting(model, 2)
