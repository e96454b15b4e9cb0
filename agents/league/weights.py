"""Weights: the number of learned parameters in files of weights."""

from __future__ import annotations

import json
import math
from functools import cache
from pathlib import Path

import onnx
from google.protobuf.message import DecodeError  # type: ignore[import-untyped]

from dohyo.sumo_networks.errors import InvalidInputError


@cache
def count_parameters(path: Path) -> int:
    """Number of learned parameters in a file, or in the files of a folder.

    A folder counts by its safetensors, or by its ONNX files where it has none: they hold the same numbers twice.

    Raises:
        InvalidInputError: There are no weights, or a file cannot be read as such.
    """
    files = [path] if path.is_file() else sorted(path.rglob("*.safetensors")) or sorted(path.rglob("*.onnx"))
    if not files:
        raise InvalidInputError(f"'{path}': expected weights (.safetensors or .onnx), found none")
    return sum(map(_count, files))


def _count(path: Path) -> int:
    try:
        if path.suffix == ".onnx":
            return sum(math.prod(one.dims) for one in onnx.load(str(path)).graph.initializer)
        content = path.read_bytes()
        header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
        return sum(math.prod(one["shape"]) for name, one in header.items() if name != "__metadata__")
    except (OSError, ValueError, OverflowError, AttributeError, KeyError, TypeError, DecodeError) as error:
        raise InvalidInputError(f"'{path}': expected weights as safetensors or ONNX, got another file") from error
