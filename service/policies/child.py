"""The sandboxed process: confines itself, then reads a model from its pipe and does one task with it.

It talks in frames: four bytes of length, then the content. Requests are raw; the first byte of an answer tells whether
it is one. Everything is imported before the confinement, since nothing can be opened after it; and the model is read
after it. See `sandbox` for the other end.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import struct
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import onnxruntime  # type: ignore[import-untyped]

GOOD, BAD = b"+", b"-"
LENGTH = struct.Struct("<I")
LARGEST_ACTION = 10_000
BACKSTOP_S = 2.0  # the parent ends a late decision; this limit applies once the parent is gone

Job = dict[str, Any]


def main() -> None:
    """Runs the one task that arrives on standard input; returns when the pipe is closed."""
    # Output of libraries must not mix with the answers.
    answers = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    job: Job = json.loads(_read())
    try:
        task, protections = _prepare(job)
    except Exception as error:  # reported to the parent, which then runs nothing
        _write(answers, BAD, str(error))
        return
    _write(answers, GOOD, json.dumps(protections))
    try:
        task(job, answers)
    except EOFError:
        return
    except MemoryError:
        _write(answers, BAD, "it needs more memory than it may have")
    except Exception as error:  # a hostile model may make the libraries raise anything
        _write(answers, BAD, str(error) or type(error).__name__)


def _prepare(job: Job) -> tuple[Callable[[Job, int], None], dict[str, Any]]:
    """Imports the task's libraries, then confines the process; returns the task and the protections."""
    from dohyo.service.policies.confinement import confine, leave_network

    own_network = leave_network()  # first, while the process has one thread
    if job["task"] != "probe":
        __import__("onnx" if job["task"] == "inspect" else "onnxruntime")
    if job["task"] == "inspect":
        from dohyo.service.policies import inspection  # noqa: F401 - imported for later
    protections = confine(job["memory_mb"], job["cpu_s"])
    return TASKS[job["task"]], {**protections, "own_network": own_network}


def _inspect(job: Job, answers: int) -> None:
    from dohyo.service.policies.inspection import inspect_model

    _write(answers, GOOD, json.dumps(inspect_model(bytes(_read()))))


def _drive(job: Job, answers: int) -> None:
    """Loads the model, reports it, then answers observations with actions until the pipe is closed."""
    import numpy as np

    content = bytes(_read())
    _deadline(job["load_s"])
    session = _session(content, job["seed"])
    del content
    sensors: list[tuple[str, list[int], str]] = job["inputs"]
    named = {value.name: value for value in session.get_inputs()}
    request = bytearray(sum(_size(shape, dtype) for _, shape, dtype in sensors))
    feed, at = {}, 0
    for name, shape, dtype in sensors:
        if name not in named:
            raise ValueError(f"it has no input '{name}'")
        view = np.frombuffer(request, np.dtype(dtype), int(np.prod(shape)), at)
        feed[name] = view.reshape([1] * (len(named[name].shape) - len(shape)) + shape)
        at += view.nbytes
    states = [name for name in named if name not in feed]
    feed |= {name: np.zeros(named[name].shape, np.float32) for name in states}
    outputs = ["action", *(f"next_{name}" for name in states)]
    _deadline(0.0)
    _write(answers, GOOD, "")
    while True:
        _read_into(request)
        _deadline(job["decision_s"])
        action, *after = session.run(outputs, feed)
        feed.update(zip(states, after, strict=True))
        _deadline(0.0)
        _write(answers, GOOD, _packed(action))


def _session(content: bytes, seed: int) -> onnxruntime.InferenceSession:
    """Session with one thread, the ONNX format only, and seeded random operators."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    options.log_severity_level = 4
    # Otherwise bytes in onnxruntime's own format would bypass all checks.
    options.add_session_config_entry("session.load_model_format", "ONNX")
    onnxruntime.set_seed(seed)
    return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


def _packed(action: Any) -> bytes:
    """Packs an action: the number of dimensions, the dimensions, then float32 values."""
    if getattr(action, "dtype", None) != "float32":
        raise ValueError(f"output 'action' is {getattr(action, 'dtype', 'no tensor')}, expected float32")
    if action.size > LARGEST_ACTION or action.ndim > 8:
        raise ValueError(f"output 'action' has {action.size} numbers in {action.ndim} dimensions")
    return struct.pack(f"<{1 + action.ndim}I", action.ndim, *action.shape) + bytes(action.tobytes())


def _probe(job: Job, answers: int) -> None:
    """Attempts forbidden actions and returns the result of each attempt."""
    attempts: dict[str, Callable[[], object]] = {
        "open a socket": socket.socket,
        "open a pair of sockets": socket.socketpair,
        "read a file": lambda: os.open("/etc/passwd", os.O_RDONLY),
        "write a file": lambda: os.open("written", os.O_WRONLY | os.O_CREAT),
        "list a directory": lambda: os.listdir("/"),
        "start a process": lambda: os.fork() or os._exit(0),
        "run a program": lambda: os.execv("/bin/true", ["true"]),
        "signal its parent": lambda: os.kill(job["parent"], 0),
        "change its user": lambda: os.setuid(0),
        "take more memory": lambda: bytearray(job["memory_mb"] * 1_000_000),
    }
    _write(answers, GOOD, json.dumps({name: _attempt(attempt) for name, attempt in attempts.items()}))


def _attempt(attempt: Callable[[], object]) -> str:
    try:
        attempt()
    except (OSError, MemoryError) as error:
        return f"refused: {getattr(error, 'strerror', None) or type(error).__name__}"
    return "possible"


TASKS: dict[str, Callable[[Job, int], None]] = {"inspect": _inspect, "drive": _drive, "probe": _probe}


def _deadline(seconds: float) -> None:
    """Lets the kernel end this process after that time; 0: never."""
    signal.setitimer(signal.ITIMER_REAL, seconds + BACKSTOP_S if seconds else 0.0)


def _size(shape: list[int], dtype: str) -> int:
    values = 1
    for length in shape:
        values *= length
    return values * {"float32": 4, "uint8": 1}[dtype]


def _read() -> bytearray:
    """The next frame."""
    head = bytearray(LENGTH.size)
    _read_into(head)
    frame = bytearray(LENGTH.unpack(head)[0])
    _read_into(frame)
    return frame


def _read_into(buffer: bytearray) -> None:
    """Reads bytes from standard input until a buffer is full.

    Raises:
        EOFError: The pipe was closed.
    """
    view = memoryview(buffer)
    while view:
        count = os.readv(0, [view])
        if count == 0:
            raise EOFError
        view = view[count:]


def _write(pipe: int, kind: bytes, content: str | bytes) -> None:
    """Sends a frame; long messages are cut to the parent's limit."""
    if isinstance(content, str):
        content = content.encode(errors="replace")
    if kind == BAD:
        content = content[:1000]
    frame = LENGTH.pack(1 + len(content)) + kind + content
    while frame:
        frame = frame[os.write(pipe, frame) :]
