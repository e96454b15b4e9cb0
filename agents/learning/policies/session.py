"""ONNX Runtime as all systems open it: one thread, on the processor."""

from __future__ import annotations

from pathlib import Path

import onnxruntime  # type: ignore[import-untyped]

from dohyo.sumo_networks.errors import InvalidInputError


def session_of(model: bytes) -> onnxruntime.InferenceSession:
    """Session of a model of our own making; what onnxruntime raises is not translated."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


def session_from(path: Path, kind: str) -> onnxruntime.InferenceSession:
    """Session of a model's file.

    Args:
        path: Of the file.
        kind: What it should hold, for the error: "policy".

    Raises:
        InvalidInputError: The file is missing, or no ONNX model.
    """
    if not path.is_file():
        raise InvalidInputError(f"no {kind} '{path}'")
    try:
        return session_of(path.read_bytes())
    except Exception as error:  # onnxruntime's own errors share no base class
        raise InvalidInputError(f"'{path}' is no ONNX model: {str(error).splitlines()[0]}") from error
