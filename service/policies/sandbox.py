"""Sandbox: an ONNX model in a confined process that can only compute.

The model's bytes, the observations and the actions go over pipes; `confinement.rights` says what the process gives up.
"""

from __future__ import annotations

import json
import re
import struct

import numpy as np

from dohyo.service.confinement.errors import TaskError, TaskTimeoutError
from dohyo.service.confinement.limits import Limits
from dohyo.service.confinement.process import ConfinedProcess
from dohyo.service.policies.interface import ACTION, Tensor
from dohyo.service.policies.limits import PolicyLimits
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import AgentError, AgentTimeoutError
from dohyo.sumo_networks.sensors import Observation

OUT_OF_MEMORY = re.compile("Failed to allocate memory|bad_alloc|more memory than")
SOURCE_LINE = re.compile(r"/onnxruntime_src/\S+ .*?\) (?=[A-Z\[])|\[ONNXRuntimeError\] : \d+ : [A-Z_]+ : ")


def inspect_safely(content: bytes, limits: PolicyLimits) -> bytes:
    """Description of a file by itself, see `inspection.inspect_model`; parsed in a confined process.

    Returns:
        JSON from a process that has read hostile bytes: not to be trusted.

    Raises:
        AgentError: The file is not an ONNX model, or parsing it exceeds a limit.
        ConfinementError: The process cannot be started or confined.
    """
    process = ConfinedProcess("inspect_policy", confined(limits))
    try:
        process.send(content, limits.load_s, "reading it")
        return process.receive(limits.load_s, "reading it")
    except TaskError as error:
        raise _agents_fault(error, limits) from error
    finally:
        process.end()


class Sandbox:
    """A loaded model; one process, for one episode.

    Attributes:
        pid: Identifier of the process.
        layers: Layers of its confinement, see `confinement.rights.give_up`.
    """

    def __init__(
        self, content: bytes, inputs: tuple[Tensor, ...], limits: PolicyLimits, seed: int, output: str = ACTION
    ) -> None:
        """Starts the process and loads the model.

        Args:
            content: Content of the .onnx file.
            inputs: Inputs that an observation holds.
            limits: Resources that the model may use.
            seed: Seed of its random operators.
            output: Name of the output that holds the action.

        Raises:
            AgentError: The model cannot be loaded.
            AgentTimeoutError: The model does not load in time.
            ConfinementError: The process cannot be started or confined.
        """
        self._inputs, self._limits = inputs, limits
        job = {
            "seed": seed % 2**31,
            "inputs": [(tensor.name, tensor.shape, tensor.dtype) for tensor in inputs],
            "load_s": limits.load_s,
            "decision_s": limits.decision_s,
            "output": output,
        }
        self._process = ConfinedProcess("drive_policy", confined(limits))
        self.pid, self.layers = self._process.pid, self._process.layers
        try:
            self._process.send(json.dumps(job).encode(), limits.load_s, "loading it")
            self._process.send(content, limits.load_s, "loading it")
            self._process.receive(limits.load_s, "loading it")
        except BaseException as error:
            self.close()
            raise _agents_fault(error, limits) from error.__cause__

    def decide(self, observation: Observation) -> Float32Array:
        """The model's action, of any shape.

        Args:
            observation: One array per input.

        Raises:
            AgentError: The model failed, or its process has ended.
            AgentTimeoutError: The model did not answer in time; its process was ended.
        """
        request = b"".join(_raw(tensor, observation) for tensor in self._inputs)
        seconds = self._limits.decision_s
        try:
            self._process.send_raw(request, seconds, "a decision")
            return _action(self._process.receive(seconds, "a decision"))
        except BaseException as error:  # after an outer deadline the next answer in the pipe would be an old one
            self.close()
            raise _agents_fault(error, self._limits) from error.__cause__

    def close(self) -> None:
        """Ends the process; a second call has no effect."""
        self._process.end()


def confined(limits: PolicyLimits) -> Limits:
    """Limits of the process of a policy."""
    return Limits(cpu_s=limits.cpu_s, memory_mb=limits.memory_mb, address_mb=limits.memory_mb, file_mb=0, answer_mb=1.0)


def _agents_fault(error: BaseException, limits: PolicyLimits) -> BaseException:
    """A task's error as the agent's; any other error as it is."""
    if isinstance(error, TaskTimeoutError):
        return AgentTimeoutError(str(error))
    return AgentError(_reason(str(error), limits)) if isinstance(error, TaskError) else error


def _raw(tensor: Tensor, observation: Observation) -> bytes:
    array = np.asarray(observation[tensor.name], dtype=tensor.dtype)
    if array.shape != tensor.shape:
        raise AgentError(f"sensor '{tensor.name}': expected shape {tensor.shape}, got {array.shape}")
    return array.tobytes()


def _action(answer: bytes) -> Float32Array:
    """The array an answer holds; see `driving._packed`."""
    try:
        (dimensions,) = struct.unpack_from("<I", answer)
        if dimensions > 8:
            raise ValueError
        shape = struct.unpack_from(f"<{dimensions}I", answer, 4)
        return np.frombuffer(answer, np.float32, offset=4 + 4 * dimensions).reshape(shape).copy()
    except (struct.error, ValueError):
        raise AgentError("its process answered nonsense") from None


def _reason(text: str, limits: PolicyLimits) -> str:
    """The message of the process in one line, without onnxruntime's source lines and C++ signatures."""
    if OUT_OF_MEMORY.search(text):
        return f"it needs more than the {limits.memory_mb} MB of memory it may have"
    text = " ".join(SOURCE_LINE.sub("", text).split())
    return "".join(character if character.isprintable() else "?" for character in text)[:400]
