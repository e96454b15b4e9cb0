"""Export of the network to ONNX: python -m dohyo.agents.mcts.predictors.export predictor.safetensors predictor.onnx."""

from __future__ import annotations

import argparse
import io
import warnings
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file

from dohyo.agents.mcts.predictors.features import SHAPES
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


def export(network: MotionNetwork, path: Path) -> None:
    """Writes an ONNX model with the inputs of `features.SHAPES`, a batch of one, and the output `poses`."""
    example = tuple(torch.zeros(1, *shape) for shape in SHAPES.values())
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the tracing exporter is deprecated, the other one needs onnxscript
        torch.onnx.export(
            network.eval(),
            example,
            buffer,  # type: ignore[arg-type]
            input_names=list(SHAPES),
            output_names=["poses"],
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
