"""Memory that a process shares with its workers: it has no name in the file system, so nothing can be left behind."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from multiprocessing.context import BaseContext
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

Layout = Mapping[str, tuple[DTypeLike, tuple[int, ...]]]
"""Type and shape of each array, by name."""


class SharedMemory:
    """Arrays in shared memory, in the form that is sent to another process."""

    def __init__(self, context: BaseContext, layout: Layout) -> None:
        self._blocks: dict[str, tuple[Any, str, tuple[int, ...]]] = {}
        for name, (dtype, shape) in layout.items():
            size = int(np.prod(shape)) * np.dtype(dtype).itemsize
            self._blocks[name] = context.RawArray(ctypes.c_byte, size), np.dtype(dtype).str, shape

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Views of the memory as arrays of this process; zeros at first."""
        return {
            name: np.frombuffer(raw, dtype=dtype).reshape(shape) for name, (raw, dtype, shape) in self._blocks.items()
        }
