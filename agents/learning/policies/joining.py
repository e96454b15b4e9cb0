"""Joining: a policy of a training between two layers, as one ONNX model from sensors to the action of a control.

The policy of a run reads what a `SensorEncoder` makes. A service knows no encoder: it gives a model one input for each
sensor, and keeps its states from tick to tick. The layer before the policy does in torch what the encoder does, with
states for what it remembers; the layer behind it does what the decoder does.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import onnx
import torch
from onnx.compose import add_prefix, merge_models
from torch import Tensor, nn

from dohyo.agents.learning.policies.export import ACTION, OPSET

CHOSEN = f"policy.{ACTION}"
"""Input of the layer behind the policy: (1, ...) the policy's action."""
TICKS, NEXT = "state_ticks", "next_"
"""State that counts the decisions of an episode, (1,); and the prefix of what follows a state."""


def joined(before: onnx.ModelProto, policy: Path, after: onnx.ModelProto) -> bytes:
    """One model of three, connected where an output is named like an input.

    Args:
        before: Of `exported`; its outputs are the policy's inputs, states, and what the layer behind it reads.
        policy: ONNX file of a training.
        after: Of `exported`, with the input `CHOSEN` and the output "action".
    """
    chosen = add_prefix(onnx.load(policy), "policy.", rename_inputs=False)
    whole = chained({"before": before, "": chosen, "after": after})
    onnx.checker.check_model(whole)
    return bytes(whole.SerializeToString())


def chained(parts: Mapping[str, onnx.ModelProto]) -> onnx.ModelProto:
    """One model of several, each connected to those before it where an output is named like an input.

    Args:
        parts: By the prefix of the names inside, which must differ; "" leaves them.
    """
    first, *others = (
        add_prefix(part, f"{prefix}.", rename_inputs=False, rename_outputs=False) if prefix else part
        for prefix, part in parts.items()
    )
    for part in others:
        part.ir_version = first.ir_version
        read = {value.name for value in part.graph.input}
        ends = [(one.name, one.name) for one in first.graph.output if one.name in read]
        first = merge_models(first, part, io_map=ends)
    return first


def exported(layer: nn.Module, inputs: Mapping[str, Tensor], outputs: Sequence[str]) -> onnx.ModelProto:
    """A layer as an ONNX model.

    Args:
        layer: Takes the inputs in their order, and returns a tuple.
        inputs: Examples by name; their shapes are fixed.
        outputs: Names of what it returns.
    """
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # see `export`
        torch.onnx.export(
            layer,
            tuple(inputs.values()),
            buffer,  # type: ignore[arg-type]
            input_names=list(inputs),
            output_names=list(outputs),
            opset_version=OPSET,
            dynamo=False,
        )
    return onnx.load_from_string(buffer.getvalue())


def pushed(memory: Tensor, new: Tensor, ticks: Tensor) -> Tensor:
    """(N, ...) a memory with a new value behind those that it had; at the episode's first tick, of that value alone.

    Args:
        memory: (N, ...), the oldest value first.
        new: (...).
        ticks: (1,) decisions before this one.
    """
    first = new[None].expand(memory.shape)
    return torch.where(ticks.reshape([1] * memory.ndim) < 0.5, first, torch.cat([memory[1:], new[None]]))


def decides(ticks: Tensor, action_repeat: int) -> Tensor:
    """(1,) whether the policy decides after so many ticks, or its last action is repeated; see `PolicyAgent`."""
    return torch.remainder(ticks, float(action_repeat)) < 0.5
