"""Export of policies: weights as safetensors and an ONNX model, each with the facts of its training."""

from __future__ import annotations

import copy
import io
import json
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, Protocol, cast

import numpy as np
import onnx
import torch
from gymnasium.spaces import Box, Dict
from safetensors.torch import save
from torch import Tensor, nn

from dohyo.agents.learning.tasks.task import ACTION as ACTION
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

OPSET = 17
_LENGTH: Final = 8  # bytes of the length of safetensors' header, and what the header's own is a multiple of


class Exportable(Protocol):
    """Torch module: observations by name, (B, ...) each -> actions in the action space.

    Pictures come as uint8, so that the module brings them to its own scale. Actions are (B, A) float32, or (B,) int64
    where they are discrete.
    """

    def __call__(self, observation: Mapping[str, Tensor]) -> Tensor:
        """Actions for a batch, without exploration."""

    def facts(self) -> Mapping[str, str]:
        """Constructor's arguments, needed beside the weights to load it."""


def export(policy: Exportable, space: Dict, path: Path, facts: Mapping[str, str]) -> None:
    """Writes PATH.safetensors and PATH.onnx.

    The ONNX model has an input for every observation that the policy uses, named like it and of its type, and the
    output "action"; the batch may have any size.

    Args:
        policy: A torch module.
        space: Of one observation, by name.
        path: Without suffix.
        facts: Of the training, for both files' metadata.

    Raises:
        InvalidInputError: An observation has the output's name.
    """
    if ACTION in space.spaces:
        raise InvalidInputError(f"policy '{path}': expected no observation named as its output, got '{ACTION}'")
    module = copy.deepcopy(cast(nn.Module, policy)).cpu().eval()
    facts = {**policy.facts(), **facts}
    weights = {name: tensor.detach().contiguous() for name, tensor in module.state_dict().items()}
    # The model first: if both files exist, they are of the same policy, or the weights are older.
    write_atomically(path.with_name(f"{path.name}.onnx"), _onnx(module, space, facts))
    write_atomically(path.with_name(f"{path.name}.safetensors"), saved(weights, facts))


def saved(weights: Mapping[str, Tensor], facts: Mapping[str, str]) -> bytes:
    """Weights and facts as safetensors, in the order of their names; the library's own order of facts is random.

    The format: the header's length in eight bytes, the header as JSON, filled with spaces to a multiple of eight bytes,
    and the numbers, at places that count from the header's end.
    """
    plain = save(dict(weights))
    begins = _LENGTH + int.from_bytes(plain[:_LENGTH], "little")
    entries = json.loads(plain[_LENGTH:begins]) | {"__metadata__": dict(facts)}
    header = json.dumps(entries, sort_keys=True, separators=(",", ":")).encode()
    header += b" " * (-len(header) % _LENGTH)
    return len(header).to_bytes(_LENGTH, "little") + header + plain[begins:]


class _OfTensors(nn.Module):
    """The policy as a function of one tensor per observation, as ONNX wants it."""

    def __init__(self, policy: nn.Module, names: Sequence[str]) -> None:
        super().__init__()
        self.policy, self.names = policy, tuple(names)

    def forward(self, *observations: Tensor) -> Tensor:
        return cast(Tensor, self.policy(dict(zip(self.names, observations, strict=True))))


def _onnx(module: nn.Module, space: Dict, facts: Mapping[str, str]) -> bytes:
    names = list(space.spaces)
    examples = tuple(torch.from_numpy(np.zeros((2, *one.shape), one.dtype)) for one in map(_box, space.spaces.values()))
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the tracing exporter is deprecated, the other one needs onnxscript
        torch.onnx.export(
            _OfTensors(module, names),
            examples,
            buffer,  # type: ignore[arg-type]
            input_names=names,
            output_names=[ACTION],
            dynamic_axes={name: {0: "batch"} for name in (*names, ACTION)},
            opset_version=OPSET,
            dynamo=False,
        )
    model = onnx.load_from_string(buffer.getvalue())
    onnx.helper.set_model_props(model, dict(facts))
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


def _box(space: object) -> Box:
    assert isinstance(space, Box)
    return space
