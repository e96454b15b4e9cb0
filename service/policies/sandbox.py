"""Sandbox: an ONNX model in a separate process that can only compute.

The model's bytes, the observations and the actions go over pipes, in frames whose length is bounded at both ends.
`confinement` says what the process gives up; this end bounds time, and ends the process when it is over.
"""

from __future__ import annotations

import fcntl
import json
import math
import os
import re
import select
import signal
import struct
import subprocess
import sys
import time
import weakref
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from dohyo.service.policies.child import GOOD, LENGTH
from dohyo.service.policies.interface import Tensor
from dohyo.service.policies.limits import PolicyLimits
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.envs.driving_env import Observation
from dohyo.sumo_networks.errors import AgentError, AgentTimeoutError, SimulationError

START_S = 30.0
LARGEST_ANSWER = 1_000_000
PIPE_BYTES = 1 << 20
ROOT = Path(__file__).parents[2]
START = "import sys; sys.path.append(sys.argv[1]); from dohyo.service.policies.child import main; main()"
OUT_OF_MEMORY = re.compile("Failed to allocate memory|bad_alloc|more memory than")
SOURCE_LINE = re.compile(r"/onnxruntime_src/\S+ .*?\) (?=[A-Z\[])|\[ONNXRuntimeError\] : \d+ : [A-Z_]+ : ")
# None of our environment. One thread in numpy's libraries; onnxruntime's wheels send telemetry unless disabled.
ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "ORT_DISABLE_TELEMETRY": "1"}


class SandboxError(SimulationError):
    """This machine cannot run policies safely at the moment. Says nothing about the policy."""


def inspect_safely(content: bytes, limits: PolicyLimits) -> bytes:
    """Description of a file by itself, see `inspection.inspect_model`; parsed in a sandboxed process.

    Returns:
        JSON from a process that has read hostile bytes: not to be trusted.

    Raises:
        AgentError: The file is not an ONNX model, or parsing it exceeds a limit.
        SandboxError: The sandbox cannot be started.
    """
    child = _Child({"task": "inspect"}, limits)
    try:
        child.send(content, limits.load_s, "reading it")
        return child.receive(limits.load_s, "reading it")
    finally:
        child.end()


def probe(limits: PolicyLimits | None = None) -> dict[str, Any]:
    """Protections on this machine: rights that the sandboxed process gave up, and results of its attempts to escape.

    Raises:
        SandboxError: The sandbox cannot be started.
    """
    limits = limits or PolicyLimits()
    child = _Child({"task": "probe", "parent": os.getpid()}, limits)
    try:
        return {**child.protections, "attempts": json.loads(child.receive(START_S, "probing"))}
    finally:
        child.end()


class Sandbox:
    """A loaded model; one process, for one episode.

    Attributes:
        pid: Identifier of the process.
        protections: Rights that the process gave up, see `confinement.confine`.
    """

    def __init__(self, content: bytes, inputs: tuple[Tensor, ...], limits: PolicyLimits, seed: int) -> None:
        """Starts the process and loads the model.

        Args:
            content: Content of the .onnx file.
            inputs: Inputs that an observation holds.
            limits: Resources that the model may use.
            seed: Seed of its random operators.

        Raises:
            AgentError: The model cannot be loaded.
            AgentTimeoutError: The model does not load in time.
            SandboxError: The sandbox cannot be started.
        """
        self._inputs, self._limits = inputs, limits
        job = {
            "task": "drive",
            "seed": seed % 2**31,
            "inputs": [(tensor.name, tensor.shape, tensor.dtype) for tensor in inputs],
            "load_s": limits.load_s,
            "decision_s": limits.decision_s,
        }
        self._child = _Child(job, limits)
        self.pid, self.protections = self._child.pid, self._child.protections
        try:
            self._child.send(content, limits.load_s, "loading it")
            self._child.receive(limits.load_s, "loading it")
        except BaseException:
            self.close()
            raise

    def decide(self, observation: Observation) -> Float32Array:
        """The model's output `action`, of any shape.

        Args:
            observation: One array per input.

        Raises:
            AgentError: The model failed, or its process has ended.
            AgentTimeoutError: The model did not answer in time; its process was ended.
        """
        request = b"".join(_raw(tensor, observation) for tensor in self._inputs)
        seconds = self._limits.decision_s
        try:
            self._child.send_raw(request, seconds, "a decision")
            return _action(self._child.receive(seconds, "a decision"))
        except BaseException:  # after an outer deadline the next answer in the pipe would be an old one
            self.close()
            raise

    def close(self) -> None:
        """Ends the process; a second call has no effect."""
        self._child.end()


class _Child:
    """The parent's handle of the process and its pipes."""

    def __init__(self, job: Mapping[str, Any], limits: PolicyLimits) -> None:
        self._limits = limits
        try:
            process = subprocess.Popen(
                [sys.executable, "-I", "-B", "-c", START, str(ROOT)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=ENVIRONMENT,
                cwd="/",
                bufsize=0,
            )
        except OSError as error:
            raise SandboxError(f"the process for a policy cannot be started: {error}") from error
        assert process.stdin is not None
        assert process.stdout is not None
        self.pid, self._process = process.pid, process
        self._in, self._out = process.stdin.fileno(), process.stdout.fileno()
        # Runs without a call of `close` and at exit too, so that no process is left behind.
        self.end = weakref.finalize(self, _end, process)
        os.set_blocking(self._in, False)
        os.set_blocking(self._out, False)
        self._writable, self._readable = select.poll(), select.poll()
        self._writable.register(self._in, select.POLLOUT)
        self._readable.register(self._out, select.POLLIN)
        try:
            _widen(self._in)
            self.send(json.dumps({**job, "memory_mb": limits.memory_mb, "cpu_s": limits.cpu_s}).encode(), START_S, "")
            self.protections: dict[str, Any] = json.loads(self.receive(START_S, "starting"))
            process.send_signal(0)
        except PermissionError as error:
            self.end()
            raise SandboxError("this machine does not let the service end a policy's process") from error
        except (AgentError, ValueError) as error:
            self.end()
            raise SandboxError(f"this machine cannot confine a policy: {error}") from error
        except BaseException:
            self.end()
            raise

    def send(self, content: bytes, seconds: float, what: str) -> None:
        """Sends a frame; see `send_raw`."""
        self.send_raw(LENGTH.pack(len(content)) + content, seconds, what)

    def send_raw(self, content: bytes, seconds: float, what: str) -> None:
        """Sends bytes of a length that the process knows.

        Raises:
            AgentError: The process has ended.
            AgentTimeoutError: The process does not read in time and was ended.
        """
        if not self.end.alive:
            raise AgentError("the policy's process has ended")
        until, view = time.monotonic() + seconds, memoryview(content)
        while view:
            try:
                view = view[os.write(self._in, view) :]
            except BlockingIOError:
                self._wait(self._writable, until, seconds, what)
            except BrokenPipeError:
                # The process may have sent its reason before it ended.
                self.receive(seconds, what)
                raise self._died(what) from None

    def receive(self, seconds: float, what: str) -> bytes:
        """The content of the next answer.

        Raises:
            AgentError: The model failed or its process has ended.
            AgentTimeoutError: There is none in time; the process was ended.
        """
        until, got, size = time.monotonic() + seconds, b"", LENGTH.size
        while len(got) < size:
            self._wait(self._readable, until, seconds, what)
            part = os.read(self._out, size - len(got))
            if not part:
                raise self._died(what)
            got += part
            if len(got) == LENGTH.size:
                size += LENGTH.unpack(got)[0]
                if not LENGTH.size < size <= LARGEST_ANSWER:
                    raise AgentError("the policy's process answered nonsense")
        kind, content = got[LENGTH.size : LENGTH.size + 1], got[LENGTH.size + 1 :]
        if kind != GOOD:
            raise AgentError(_reason(content, self._limits))
        return content

    def _wait(self, poll: select.poll, until: float, seconds: float, what: str) -> None:
        left = until - time.monotonic()
        if left <= 0 or not poll.poll(math.ceil(left * 1000)):
            self.end()
            raise AgentTimeoutError(f"the policy's process was ended: {what} took longer than {seconds:g} s")

    def _died(self, what: str) -> AgentError:
        """Reason of a missing answer; ends the process if it still runs."""
        try:
            code = self._process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            code = 0
        self.end()
        limits = self._limits
        reasons = {
            -signal.SIGXCPU: f"it used more than {limits.cpu_s} s of processor time",
            -signal.SIGALRM: f"{what} took too long",
        }
        crash = f"code {code}" if code >= 0 else signal.Signals(-code).name
        memory = f"it crashed ({crash}), as it does when it needs more than {limits.memory_mb} MB"
        return AgentError(f"the policy's process ended: {reasons.get(code, memory)} ({what})")


def _end(process: subprocess.Popen[bytes]) -> None:
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()
    with suppress(PermissionError):  # the process ends itself, since its pipe is closed
        process.kill()
    process.wait()


def _widen(pipe: int) -> None:
    """Enlarges the pipe, so that a camera image passes in one piece where the system allows it."""
    try:
        fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
    except OSError:
        return


def _raw(tensor: Tensor, observation: Observation) -> bytes:
    array = np.asarray(observation[tensor.name], dtype=tensor.dtype)
    if array.shape != tensor.shape:
        raise AgentError(f"sensor '{tensor.name}': expected shape {tensor.shape}, got {array.shape}")
    return array.tobytes()


def _action(answer: bytes) -> Float32Array:
    """The array an answer holds; see `child._packed`."""
    try:
        (dimensions,) = struct.unpack_from("<I", answer)
        if dimensions > 8:
            raise ValueError
        shape = struct.unpack_from(f"<{dimensions}I", answer, 4)
        return np.frombuffer(answer, np.float32, offset=4 + 4 * dimensions).reshape(shape).copy()
    except (struct.error, ValueError):
        raise AgentError("the policy's process answered nonsense") from None


def _reason(message: bytes, limits: PolicyLimits) -> str:
    """The message of the process in one line, without onnxruntime's source lines and C++ signatures."""
    text = message.decode(errors="replace")
    if OUT_OF_MEMORY.search(text):
        return f"it needs more than the {limits.memory_mb} MB of memory it may have"
    text = " ".join(SOURCE_LINE.sub("", text).split())
    return "".join(character if character.isprintable() else "?" for character in text)[:400]
