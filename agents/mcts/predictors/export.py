"""Export of the network to ONNX: python -m dohyo.agents.mcts.predictors.export predictor.safetensors predictor.onnx."""

from __future__ import annotations

import argparse
import io
import warnings
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn

from dohyo.agents.mcts.predictors.described import SHAPES, sized
from dohyo.agents.mcts.predictors.network import MotionNetwork
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

OPSET = 17


def load_network(path: Path) -> MotionNetwork:
    """The trained network.

    Raises:
        InvalidInputError: The file is missing, damaged, or of another network.
    """
    network = MotionNetwork()
    try:
        network.load_state_dict(load_file(path))
    except FileNotFoundError as error:
        raise InvalidInputError(f"no predictor '{path}'") from error
    except (OSError, SafetensorError, RuntimeError) as error:
        raise InvalidInputError(f"'{path}' is no predictor of this network: {str(error).splitlines()[0]}") from error
    return network.eval()


class _Futures(nn.Module):
    """The part of the network that is exported."""

    def __init__(self, network: MotionNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, *inputs: Tensor) -> Tensor:
        """See `MotionNetwork.futures`."""
        return self.network.futures(*inputs)


def export(network: MotionNetwork, path: Path) -> None:
    """Writes an ONNX model with the inputs of `described.SHAPES`, a batch of one, and the output `poses`.

    It takes any number of agents and of lanes, so that a scene need not be padded.
    """
    example = tuple(torch.zeros(1, *shape) for shape in sized(agents=3, lanes=2).values())
    axes = {name: {1 + i: n for i, n in enumerate(of) if isinstance(n, str)} for name, of in SHAPES.items()}
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the tracing exporter is deprecated, the other one needs onnxscript
        torch.onnx.export(
            _Futures(network.eval()),
            example,
            buffer,  # type: ignore[arg-type]
            input_names=list(SHAPES),
            output_names=["poses"],
            dynamic_axes={**axes, "poses": {1: "agents"}},
            opset_version=OPSET,
            dynamo=False,
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, buffer.getvalue())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("predictor", type=Path)
    parser.add_argument("onnx", type=Path)
    arguments = parser.parse_args()
    export(load_network(arguments.predictor), arguments.onnx)
