"""Checks of an uploaded file: whether it is an ONNX policy that may drive.

Cheap and certain checks come first: size, first bytes, the file's description of itself (read in a sandboxed process),
and last two decisions in the sandbox. A refusal is one line with the expected and the received value.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Mapping

import numpy as np
from pydantic import ValidationError

from dohyo.evaluation.agent import AgentSpec
from dohyo.service.policies.interface import NEXT_STATE, STATE, Tensor, expected_action, expected_inputs
from dohyo.service.policies.limits import MEGABYTE, PolicyLimits
from dohyo.service.policies.sandbox import Sandbox, inspect_safely
from dohyo.sumo_networks.errors import AgentError, InvalidInputError
from dohyo.sumo_networks.scenario import Config

DOMAINS = ("", "ai.onnx", "ai.onnx.ml")
OLDEST_OPSET = 7
_INTEGERS = frozenset(f"{sign}int{bits}" for sign in ("", "u") for bits in (4, 8, 16, 32, 64))
TYPES = _INTEGERS | {"bool", "bfloat16", "float16", "float32", "float64"}
ADVICE = "export the model with torch.onnx.export, or your framework's exporter, to one .onnx file"

# Common wrong uploads by their first bytes.
_TORCH = "a ZIP archive, as torch.save, TorchScript, Keras and numpy write them"
_MAGIC = (
    (b"PK\x03\x04", _TORCH),
    (b"PK\x05\x06", _TORCH),
    (b"\x1f\x8b", "compressed with gzip"),
    (b"BZh", "compressed with bzip2"),
    (b"\xfd7zXZ", "compressed with xz"),
    (b"\x28\xb5\x2f\xfd", "compressed with zstd"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive"),
    (b"Rar!", "a RAR archive"),
    (b"\x89HDF\r\n\x1a\n", "an HDF5 file, as Keras writes it"),
    (b"\x93NUMPY", "a numpy array"),
    (b"GGUF", "a GGUF file, weights without the computation"),
    (b"\x7fELF", "a program"),
    (b"MZ", "a program"),
)
_BINARY_PICKLE = re.compile(rb"\x80[\x02-\x05]")
_OLD_PICKLE = re.compile(rb"[\]})]q\x00|c[\w.]+\n[\w.]+\n|\([ld]p\d+\n")
_SAFETENSORS = re.compile(rb'.{8}\{\s*"', re.DOTALL)


class PolicyRefusedError(InvalidInputError):
    """An uploaded file is refused; the message names a remedy."""


class _Value(Config):
    """One input or output of the graph; None for a dynamic dimension, and for values that are not tensors."""

    name: str
    dtype: str
    shape: tuple[int | None, ...] | None


class _Model(Config):
    """Description of a file by itself, see `inspection.inspect_model`."""

    ir_version: int
    opsets: dict[str, int]
    producer: str
    nodes: int
    domains: tuple[str, ...]
    types: tuple[str, ...]
    external: str | None
    inputs: tuple[_Value, ...]
    outputs: tuple[_Value, ...]

    @property
    def opset(self) -> int:
        """Version of the standard operators; 0 where the file names none."""
        return self.opsets.get("", self.opsets.get("ai.onnx", 0))


class PolicyInfo(Config):
    """Facts of an accepted policy.

    Attributes:
        sha256: Hash of the file.
        size_bytes: Size of the file.
        producer: Exporting program, according to the file.
        ir_version: Version of the ONNX format.
        opset: Version of the standard operators.
        nodes: Number of operators, including subgraphs and functions.
        states: Shapes of the recurrent states by name.
    """

    sha256: str
    size_bytes: int
    producer: str
    ir_version: int
    opset: int
    nodes: int
    states: dict[str, tuple[int, ...]]


def check_policy(content: bytes, spec: AgentSpec, limits: PolicyLimits | None = None) -> PolicyInfo:
    """Decides whether a file may drive as an agent of a spec. Writes nothing and reads no other file.

    Raises:
        PolicyRefusedError: The file is refused.
        InvalidInputError: The spec names an unknown sensor or control, or a sensor above its track.
        ConfinementError: This machine cannot check files safely.
    """
    limits = limits or PolicyLimits()
    inputs, action = expected_inputs(spec), expected_action(spec)
    _check_size(content, limits)
    _check_format(content)
    try:
        model = _Model.model_validate_json(inspect_safely(content, limits))
    except (AgentError, ValidationError) as error:
        raise PolicyRefusedError(f"the file cannot be read: {error}; {ADVICE}") from error
    _check_contents(model, limits)
    _check_inputs(model, inputs)
    _check_output(model, action)
    states = _checked_states(model, limits)
    _check_extras(model, inputs, action, states)
    _try(content, inputs, action, limits)
    return PolicyInfo(
        sha256=hashlib.sha256(content).hexdigest(),
        size_bytes=len(content),
        producer=model.producer,
        ir_version=model.ir_version,
        opset=model.opset,
        nodes=model.nodes,
        states=states,
    )


def _check_size(content: bytes, limits: PolicyLimits) -> None:
    if not content:
        raise PolicyRefusedError("the file is empty")
    if len(content) > limits.file_mb * MEGABYTE:
        size = math.ceil(len(content) / MEGABYTE)
        raise PolicyRefusedError(f"the file has {size} MB, at most {limits.file_mb:g} MB are taken")


def _check_format(content: bytes) -> None:
    """Refuses files of other formats by their first bytes."""
    head = content[:512]
    found = next((what for magic, what in _MAGIC if head.startswith(magic)), None)
    if _BINARY_PICKLE.match(head) or _OLD_PICKLE.match(head):
        found = "a pickle, which would run code of its author's when it is loaded"
    elif head[257:262] == b"ustar":
        found = "a tar archive"
    elif _SAFETENSORS.match(head):
        found = "a safetensors file, weights without the computation"
    elif head[4:8] in (b"ORTM", b"TFL3"):
        found = "in onnxruntime's own format" if head[4:8] == b"ORTM" else "a TensorFlow Lite model"
    elif found is None and _is_text(head):
        found = "a text, such as source code, which is not run here"
    if found:
        raise PolicyRefusedError(f"the file is {found}; {ADVICE}")


def _is_text(head: bytes) -> bool:
    try:
        text = head.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return all(character.isprintable() or character in "\r\n\t\f" for character in text)


def _check_contents(model: _Model, limits: PolicyLimits) -> None:
    """Checks the graph: embedded weights, known operators within the limit, numeric tensors only."""
    if model.external is not None:
        raise PolicyRefusedError(
            f"tensor {model.external!r} is kept in another file; save all weights inside (external_data=False)"
        )
    if foreign := [domain for domain in model.domains if domain not in DOMAINS]:
        raise PolicyRefusedError(
            f"it uses operators or functions of the domain {foreign[0]!r}; only those of ai.onnx and ai.onnx.ml are run"
        )
    if model.nodes > limits.nodes:
        raise PolicyRefusedError(f"it has {model.nodes} nodes, at most {limits.nodes} are taken")
    if odd := [name for name in model.types if name not in TYPES]:
        raise PolicyRefusedError(
            f"it holds tensors of type {odd[0]}; only numbers are taken: {', '.join(sorted(TYPES))}"
        )
    if model.opset < OLDEST_OPSET:
        raise PolicyRefusedError(f"it is written for opset {model.opset}; expected {OLDEST_OPSET} or later")


def _check_inputs(model: _Model, inputs: tuple[Tensor, ...]) -> None:
    given = {value.name: value for value in model.inputs}
    for tensor in inputs:
        if tensor.name not in given:
            named = ", ".join(repr(name) for name in given) or "none"
            raise PolicyRefusedError(f"it has no input '{tensor.name}', of shape {_text(tensor.shape)}; it has {named}")
        _check_tensor(f"input '{tensor.name}'", given[tensor.name], tensor)


def _check_output(model: _Model, action: Tensor) -> None:
    given = {value.name: value for value in model.outputs}
    if action.name not in given:
        named = ", ".join(repr(name) for name in given) or "none"
        raise PolicyRefusedError(f"it has no output '{action.name}', of shape {_text(action.shape)}; it has {named}")
    _check_tensor(f"output '{action.name}'", given[action.name], action)


def _check_tensor(what: str, given: _Value, expected: Tensor) -> None:
    """Shape, but for a leading batch dimension of 1 or of no fixed length, and element type.

    A tensor with an open end may have a dynamic last dimension.
    """
    shape = given.shape
    batch = shape is not None and len(shape) == len(expected.shape) + 1 and shape[0] in (1, None)
    own = None if shape is None else tuple(shape[1:] if batch else shape)
    if expected.open_end and own and own[-1] is None:
        own = (*own[:-1], expected.shape[-1])
    if own != expected.shape:
        wanted = f"{_text(expected.shape)} or {_text((1, *expected.shape))}"
        raise PolicyRefusedError(f"{what}: expected shape {wanted}, got {_text(shape)}")
    if given.dtype != expected.dtype:
        raise PolicyRefusedError(f"{what}: expected {expected.dtype}, got {given.dtype}")


def _checked_states(model: _Model, limits: PolicyLimits) -> dict[str, tuple[int, ...]]:
    """Shapes of the recurrent states, by name."""
    outputs = {value.name: value for value in model.outputs}
    states = {}
    for value in model.inputs:
        if not value.name.startswith(STATE):
            continue
        follower = NEXT_STATE + value.name.removeprefix(STATE)
        if follower not in outputs:
            raise PolicyRefusedError(f"input {value.name!r} has no output {follower!r}")
        shape = tuple(length for length in value.shape or () if length is not None and length > 0)
        if shape != value.shape:
            raise PolicyRefusedError(f"input {value.name!r}: expected a fixed shape, got {_text(value.shape)}")
        for what, given in ((f"input {value.name!r}", value), (f"output {follower!r}", outputs[follower])):
            if given.shape != shape or given.dtype != "float32":
                got = f"{given.dtype} of shape {_text(given.shape)}"
                raise PolicyRefusedError(f"{what}: expected float32 of shape {_text(shape)}, got {got}")
        states[value.name] = shape
    values = sum(math.prod(shape) for shape in states.values())
    if values > limits.state_values:
        raise PolicyRefusedError(f"its states hold {values} numbers, at most {limits.state_values} are taken")
    return states


def _check_extras(model: _Model, inputs: tuple[Tensor, ...], action: Tensor, states: Mapping[str, object]) -> None:
    """Checks that every input has a source and every output a use."""
    fed = {tensor.name for tensor in inputs} | set(states)
    if extra := [value.name for value in model.inputs if value.name not in fed]:
        names = ", ".join(tensor.name for tensor in inputs)
        raise PolicyRefusedError(f"input {extra[0]!r} is no sensor of this agent ({names}) and no '{STATE}...'")
    read = {action.name} | {NEXT_STATE + name.removeprefix(STATE) for name in states}
    if extra := [value.name for value in model.outputs if value.name not in read]:
        raise PolicyRefusedError(
            f"output {extra[0]!r} is neither '{action.name}' nor the '{NEXT_STATE}...' of an input"
        )


def _try(content: bytes, inputs: tuple[Tensor, ...], action: Tensor, limits: PolicyLimits) -> None:
    """Runs two decisions on zeros to check loading, time and shapes. NaN is accepted, since zeros are no real input."""
    zeros = {tensor.name: np.zeros(tensor.shape, tensor.dtype) for tensor in inputs}
    try:
        sandbox = Sandbox(content, inputs, limits, seed=0, output=action.name)
        try:
            for _ in range(2):
                answer = sandbox.decide(zeros)
        finally:
            sandbox.close()
    except AgentError as error:
        raise PolicyRefusedError(f"a trial decision failed: {error}") from error
    if answer.shape not in (action.shape, (1, *action.shape)):
        raise PolicyRefusedError(
            f"output '{action.name}': a trial decision had shape {answer.shape}, expected {action.shape}"
        )


def _text(shape: tuple[int | None, ...] | None) -> str:
    """A shape as text; "?" for a dynamic dimension."""
    if shape is None:
        return "unknown"
    return "(" + ", ".join("?" if length is None else str(length) for length in shape) + ")"
