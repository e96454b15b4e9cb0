"""Inspection: description of an ONNX file as plain data. Runs in the sandboxed process, on hostile bytes.

The file is parsed as the protocol buffer it is: onnx's own loader, which follows references to files, is not used.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import onnx
from google.protobuf.message import Message  # type: ignore[import-untyped]

from dohyo.service.confinement.frames import GOOD, Stream

MOST_NAMES = 100
LONGEST_NAME = 100


def inspect_stream(stream: Stream) -> None:
    """Answers a file's bytes with its description."""
    stream.write(GOOD, json.dumps(inspect_model(bytes(stream.read()))))


def inspect_model(content: bytes) -> dict[str, Any]:
    """Counts and lists the facts that `checks` judges.

    Raises:
        ValueError: The bytes are not an ONNX model.
    """
    model = onnx.ModelProto()
    try:
        model.ParseFromString(content)
    except Exception as error:  # protobuf's errors differ from backend to backend
        raise ValueError("the file is no ONNX model, or is cut off") from error
    if not model.HasField("graph") or not model.graph.node:
        raise ValueError("the file is no ONNX model: it has no graph with nodes")
    domains, types, external, nodes = set(), set(), None, 0
    for message in _messages(model):
        if isinstance(message, onnx.NodeProto):
            nodes += 1
            domains.add(message.domain)
        elif isinstance(message, onnx.FunctionProto):
            domains.add(message.domain)
        elif isinstance(message, onnx.TensorProto):
            types.add(message.data_type)
            if message.data_location == onnx.TensorProto.EXTERNAL or message.external_data:
                external = external or message.name[:LONGEST_NAME] or "a constant"
    constants = {tensor.name for tensor in model.graph.initializer}
    constants |= {tensor.values.name for tensor in model.graph.sparse_initializer}
    return {
        "ir_version": int(model.ir_version),
        "opsets": {entry.domain[:LONGEST_NAME]: int(entry.version) for entry in model.opset_import[:MOST_NAMES]},
        "producer": f"{model.producer_name} {model.producer_version}".strip()[:LONGEST_NAME],
        "nodes": nodes,
        "domains": sorted(domain[:LONGEST_NAME] for domain in domains)[:MOST_NAMES],
        "types": sorted(_type_name(number) for number in types)[:MOST_NAMES],
        "external": external,
        "inputs": [_value(value) for value in model.graph.input if value.name not in constants][:MOST_NAMES],
        "outputs": [_value(value) for value in model.graph.output][:MOST_NAMES],
    }


def _messages(root: Message) -> Iterator[Message]:
    """Every message within, wherever it is: subgraphs, functions, sparse tensors, training graphs, fields to come."""
    left = [root]
    while left:
        message = left.pop()
        yield message
        for field, value in message.ListFields():
            if field.message_type is not None:
                left.extend([value] if isinstance(value, Message) else value)


def _value(value: onnx.ValueInfoProto) -> dict[str, Any]:
    """Name, element type and shape; None for a dynamic dimension, and for values that are not tensors."""
    if value.type.WhichOneof("value") != "tensor_type":
        return {"name": value.name[:LONGEST_NAME], "dtype": "no tensor", "shape": None}
    tensor = value.type.tensor_type
    shape = [int(d.dim_value) if d.HasField("dim_value") else None for d in tensor.shape.dim]
    return {
        "name": value.name[:LONGEST_NAME],
        "dtype": _type_name(tensor.elem_type),
        "shape": shape[:MOST_NAMES] if tensor.HasField("shape") else None,
    }


def _type_name(number: int) -> str:
    """Name of an element type in numpy."""
    if number not in onnx.TensorProto.DataType.values():
        return f"type {number}"
    name: str = onnx.TensorProto.DataType.Name(number)
    return {"FLOAT": "float32", "DOUBLE": "float64"}.get(name, name.lower())
