"""Latents: the shipped encoder in onnxruntime, on one thread. The model is built from its weights; torch is not needed.

encoder = Encoder()
encoder.latent(observation["camera_semantic"])       # (400,) float32
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from safetensors import SafetensorError
from safetensors.numpy import load_file

from dohyo.agents.hierarchical.vision.architecture import STACK, encoder_shapes
from dohyo.agents.hierarchical.vision.classes import CLASSES, HEIGHT, WIDTH, planes
from dohyo.agents.learning.policies.session import session_of
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import InvalidInputError

SHIPPED = Path(__file__).with_name("checkpoints") / "semantic.safetensors"
OPSET, IR_VERSION = 17, 8


class Encoder:
    """Pictures of the semantic camera to latents.

    Attributes:
        size: Length of a latent vector.
        session: The network: `planes` (1, 15, 80, 160) to `latent` (1, Z) and `told` (1, 6).
    """

    def __init__(self, path: str | Path = SHIPPED) -> None:
        """Loads the encoder.

        Raises:
            InvalidInputError: The file is missing, damaged, or holds another network.
        """
        weights = load_weights(Path(path))
        self.size = len(weights["mean.bias"])
        model = onnx_model(weights).SerializeToString()
        self.session = session_of(model)

    def latent(self, picture: NDArray[Any]) -> Float32Array:
        """(Z,) the mean of the latents.

        Args:
            picture: (1, 80, 160) uint8 of the sensor `camera_semantic`.

        Raises:
            InvalidInputError: The picture has another shape or type.
        """
        return self.encode(picture)[0]

    def encode(self, picture: NDArray[Any]) -> tuple[Float32Array, Float32Array]:
        """(Z,) latents, and (6,) predictions: distances to impact and event [50 m], logits of the signal."""
        latent, told = self.session.run(None, {"planes": planes(picture)[None]})
        return latent[0], told[0]


def load_weights(path: Path) -> dict[str, Float32Array]:
    """An encoder's weights by the names of `network.Encoder`, converted to float32.

    Raises:
        InvalidInputError: The file is missing, damaged, or holds another network.
    """
    try:
        weights = {name: array.astype(np.float32) for name, array in load_file(path).items()}
    except FileNotFoundError as error:
        raise InvalidInputError(f"no encoder '{path}' (dohyo train semantic makes one)") from error
    except (OSError, SafetensorError) as error:
        raise InvalidInputError(f"encoder '{path}' is damaged: {error}") from error
    expected = encoder_shapes(len(weights.get("mean.bias", ())))
    if wrong := [n for n in sorted({*expected, *weights}) if n not in weights or weights[n].shape != expected.get(n)]:
        there = weights[wrong[0]].shape if wrong[0] in weights else "nothing"
        raise InvalidInputError(
            f"'{path}' holds another network: expected {wrong[0]} as {expected.get(wrong[0], 'nothing')}, got {there}"
        )
    if not all(np.isfinite(array).all() for array in weights.values()):
        raise InvalidInputError(f"encoder '{path}' holds NaN or infinity")
    return weights


def onnx_model(weights: dict[str, Float32Array]) -> onnx.ModelProto:
    """The encoder as an ONNX model: `planes` (1, 15, 80, 160) to `latent` (1, Z) and `told` (1, 6)."""
    nodes, here = [], "planes"
    for n in range(len(STACK.filters)):
        inputs = [here, f"convolutions.{n}.weight", f"convolutions.{n}.bias"]
        nodes.append(helper.make_node("Conv", inputs, [f"conv{n}"], strides=[STACK.stride, STACK.stride]))
        here = f"relu{n}"
        nodes.append(helper.make_node("Relu", [f"conv{n}"], [here]))
    nodes.append(helper.make_node("Flatten", [here], ["flat"]))
    for name, source, target in (("mean", "flat", "latent"), ("head", "latent", "wide"), ("told", "rectified", "told")):
        nodes.append(helper.make_node("Gemm", [source, f"{name}.weight", f"{name}.bias"], [target], transB=1))
        if name == "head":
            nodes.append(helper.make_node("Relu", ["wide"], ["rectified"]))
    graph = helper.make_graph(
        nodes,
        "semantic-encoder",
        [helper.make_tensor_value_info("planes", TensorProto.FLOAT, [1, CLASSES, HEIGHT, WIDTH])],
        [
            helper.make_tensor_value_info("latent", TensorProto.FLOAT, [1, len(weights["mean.bias"])]),
            helper.make_tensor_value_info("told", TensorProto.FLOAT, [1, len(weights["told.bias"])]),
        ],
        [numpy_helper.from_array(array, name) for name, array in sorted(weights.items())],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    onnx.checker.check_model(model)
    return model
