"""Export of actors: weights as safetensors and an ONNX model, each with the facts of its training."""

from __future__ import annotations

import copy
import io
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol, cast

import onnx
import torch
from safetensors.torch import save
from torch import Tensor, nn

from dohyo.sumo_networks.files import write_atomically

OPSET = 17


class Exportable(Protocol):
    """Torch module: (B, ...) observations -> (B, ...) actions, in the action space."""

    def __call__(self, observation: Tensor) -> Tensor:
        """Actions for a batch."""

    def facts(self) -> Mapping[str, str]:
        """Constructor's arguments, needed beside the weights to load it."""


def export(actor: Exportable, observation: Sequence[int], path: Path, facts: Mapping[str, str]) -> None:
    """Writes PATH.safetensors and PATH.onnx.

    The ONNX model has the input "observation" and the output "action", float32, with a batch of any size.

    Args:
        actor: A torch module.
        observation: Shape of one observation.
        path: Without suffix.
        facts: Of the training, for both files' metadata.
    """
    module = copy.deepcopy(cast(nn.Module, actor)).cpu().eval()
    facts = {**actor.facts(), **facts}
    weights = {name: tensor.detach().contiguous() for name, tensor in module.state_dict().items()}
    # The model first: if both files exist, they are of the same actor, or the weights are older.
    write_atomically(path.with_name(f"{path.name}.onnx"), _onnx(module, observation, facts))
    write_atomically(path.with_name(f"{path.name}.safetensors"), save(weights, facts))


def _onnx(module: nn.Module, observation: Sequence[int], facts: Mapping[str, str]) -> bytes:
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the tracing exporter is deprecated, the other one needs onnxscript
        torch.onnx.export(
            module,
            (torch.zeros(2, *observation),),
            buffer,  # type: ignore[arg-type]
            input_names=["observation"],
            output_names=["action"],
            dynamic_axes={"observation": {0: "batch"}, "action": {0: "batch"}},
            opset_version=OPSET,
            dynamo=False,
        )
    model = onnx.load_from_string(buffer.getvalue())
    onnx.helper.set_model_props(model, dict(facts))
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())
