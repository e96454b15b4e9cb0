"""Driving: an ONNX model that answers observations with actions. Runs in a confined process, on a hostile model."""

from __future__ import annotations

import json
import signal
import struct
from typing import Any

import numpy as np
import onnxruntime  # type: ignore[import-untyped]

from dohyo.service.confinement.frames import GOOD, Stream

LARGEST_ACTION = 10_000
BACKSTOP_S = 2.0  # the parent ends a late decision; this limit applies once the parent is gone


def drive(stream: Stream) -> None:
    """Loads the model, reports it, then answers observations with actions until the parent is gone."""
    job = json.loads(stream.read())
    content = bytes(stream.read())
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
    outputs = [job["output"], *(f"next_{name}" for name in states)]
    _deadline(0.0)
    stream.write(GOOD)
    while True:
        stream.read_into(request)
        _deadline(job["decision_s"])
        action, *after = session.run(outputs, feed)
        feed.update(zip(states, after, strict=True))
        _deadline(0.0)
        stream.write(GOOD, _packed(job["output"], action))


def _session(content: bytes, seed: int) -> onnxruntime.InferenceSession:
    """Session with one thread, the ONNX format only, and seeded random operators."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    options.log_severity_level = 4
    # Otherwise bytes in onnxruntime's own format would bypass all checks.
    options.add_session_config_entry("session.load_model_format", "ONNX")
    onnxruntime.set_seed(seed)
    return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


def _packed(name: str, action: Any) -> bytes:
    """Packs an action: the number of dimensions, the dimensions, then float32 values."""
    if getattr(action, "dtype", None) != "float32":
        raise ValueError(f"output '{name}' is {getattr(action, 'dtype', 'no tensor')}, expected float32")
    if action.size > LARGEST_ACTION or action.ndim > 8:
        raise ValueError(f"output '{name}' has {action.size} numbers in {action.ndim} dimensions")
    return struct.pack(f"<{1 + action.ndim}I", action.ndim, *action.shape) + bytes(action.tobytes())


def _deadline(seconds: float) -> None:
    """Lets the kernel end this process after that time; 0: never."""
    signal.setitimer(signal.ITIMER_REAL, seconds + BACKSTOP_S if seconds else 0.0)


def _size(shape: list[int], dtype: str) -> int:
    values = 1
    for length in shape:
        values *= length
    return values * {"float32": 4, "uint8": 1}[dtype]
