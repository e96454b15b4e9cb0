"""Small ONNX models: honest ones, broken ones, and ones that attack."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from dohyo.evaluation.agent import AgentSpec

SPEC = AgentSpec(name="test", sensors=("speedometer",))
SPEEDOMETER = {"speedometer": (2,)}
ACTION = {"action": (2,)}
Shapes = Mapping[str, Sequence[int | str | None]]


def model(
    nodes: Sequence[onnx.NodeProto],
    *,
    inputs: Shapes = SPEEDOMETER,
    outputs: Shapes = ACTION,
    constants: Mapping[str, np.ndarray] | None = None,
    dtype: int = TensorProto.FLOAT,
    **options: object,
) -> onnx.ModelProto:
    """A model of float32 inputs and outputs; `dtype` is the inputs'."""
    graph = helper.make_graph(
        nodes,
        "graph",
        [helper.make_tensor_value_info(name, dtype, shape) for name, shape in inputs.items()],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in outputs.items()],
        [numpy_helper.from_array(value, name) for name, value in (constants or {}).items()],
    )
    defaults = {"opset_imports": [helper.make_opsetid("", 17)], "ir_version": 9}
    return helper.make_model(graph, **(defaults | options))


def identity(**options: object) -> onnx.ModelProto:
    """Answers the speedometer's two numbers."""
    return model([helper.make_node("Identity", ["speedometer"], ["action"])], **options)


def linear() -> tuple[onnx.ModelProto, np.ndarray, np.ndarray]:
    """tanh(x W + b), with W and b."""
    rng = np.random.default_rng(1)
    weight, bias = rng.normal(size=(2, 2)).astype(np.float32), rng.normal(size=2).astype(np.float32)
    nodes = [
        helper.make_node("MatMul", ["speedometer", "W"], ["product"]),
        helper.make_node("Add", ["product", "b"], ["sum"]),
        helper.make_node("Tanh", ["sum"], ["action"]),
    ]
    return model(nodes, constants={"W": weight, "b": bias}), weight, bias


def counter(state: Sequence[int | str | None] = (1, 2), following: Sequence[int] = (1, 2)) -> onnx.ModelProto:
    """Answers the sum of all it saw so far, the present included."""
    nodes = [
        helper.make_node("Add", ["state_sum", "speedometer"], ["next_state_sum"]),
        helper.make_node("Squeeze", ["next_state_sum", "axis"], ["action"]),
    ]
    return model(
        nodes,
        inputs={**SPEEDOMETER, "state_sum": state},
        outputs={**ACTION, "next_state_sum": following},
        constants={"axis": np.array([0])},
    )


def noise() -> onnx.ModelProto:
    """Adds random numbers."""
    nodes = [
        helper.make_node("RandomNormal", [], ["noise"], shape=[2]),
        helper.make_node("Add", ["speedometer", "noise"], ["action"]),
    ]
    return model(nodes)


def loop(step: onnx.NodeProto, trips: int, shape: Sequence[int | None]) -> onnx.ModelProto:
    """Repeats a node that makes "after" from "before", and answers the first two numbers plus its sum."""
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["go_on"]), step],
        "body",
        [
            helper.make_tensor_value_info("trip", TensorProto.INT64, []),
            helper.make_tensor_value_info("go", TensorProto.BOOL, []),
            helper.make_tensor_value_info("before", TensorProto.FLOAT, shape),
        ],
        [
            helper.make_tensor_value_info("go_on", TensorProto.BOOL, []),
            helper.make_tensor_value_info("after", TensorProto.FLOAT, shape),
        ],
    )
    nodes = [
        helper.make_node("Loop", ["trips", "true", "speedometer"], ["looped"], body=body),
        helper.make_node("ReduceSum", ["looped"], ["sum"], keepdims=0),
        helper.make_node("Add", ["speedometer", "sum"], ["action"]),
    ]
    return model(nodes, constants={"trips": np.array(trips), "true": np.array(True)})


def endless() -> onnx.ModelProto:
    """Never answers."""
    return loop(helper.make_node("Sin", ["before"], ["after"]), 2**62, [2])


def doubling() -> onnx.ModelProto:
    """Doubles an array sixty times."""
    return loop(helper.make_node("Concat", ["before", "before"], ["after"], axis=0), 60, [None])


def huge_constant() -> onnx.ModelProto:
    """Asks for 100 GB at once."""
    nodes = [
        helper.make_node("ConstantOfShape", ["size"], ["zeros"]),
        helper.make_node("ReduceSum", ["zeros"], ["sum"], keepdims=0),
        helper.make_node("Add", ["speedometer", "sum"], ["action"]),
    ]
    return model(nodes, constants={"size": np.array([25_000_000_000])})


def triggered(attack: onnx.ModelProto) -> onnx.ModelProto:
    """Is honest on zeros, and attacks once the first number is above 5: what a trial decision does not see."""
    branch = helper.make_graph(
        list(attack.graph.node), "attack", [], list(attack.graph.output), list(attack.graph.initializer)
    )
    honest = helper.make_graph(
        [helper.make_node("Identity", ["speedometer"], ["honest"])],
        "honest",
        [],
        [helper.make_tensor_value_info("honest", TensorProto.FLOAT, [2])],
    )
    nodes = [
        helper.make_node("Slice", ["speedometer", "zero", "one"], ["first"]),
        helper.make_node("Squeeze", ["first"], ["speed"]),
        helper.make_node("Greater", ["speed", "five"], ["fast"]),
        helper.make_node("If", ["fast"], ["action"], then_branch=branch, else_branch=honest),
    ]
    constants = {"zero": np.array([0]), "one": np.array([1]), "five": np.array(5.0, np.float32)}
    return model(nodes, constants=constants)


def external(tensor: TensorProto, location: str = "/etc/passwd") -> TensorProto:
    """The tensor, said to be kept in another file."""
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    entry = tensor.external_data.add()
    entry.key, entry.value = "location", location
    return tensor
