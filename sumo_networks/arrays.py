"""Array types used everywhere (float64 in physics, float32 in observations), and columns of tables."""

from __future__ import annotations

from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
StringArray = NDArray[np.str_]


def column(dtype: DTypeLike, *shape: int) -> Any:
    """A dataclass field that is a column of a table; its metadata serve `objects.ObjectStates.empty`.

    Args:
        dtype: Type of the column's elements.
        shape: Shape of one row's value; empty for one number per row.
    """
    return field(metadata={"empty": np.empty((0, *shape), dtype)})
