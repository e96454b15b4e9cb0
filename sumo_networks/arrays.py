"""Array types used everywhere (float64 in physics, float32 in observations), and columns of tables."""

from __future__ import annotations

from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
StringArray = NDArray[np.str_]


def column(dtype: DTypeLike, *shape: int) -> Any:
    """A column of a table: what a dataclass field needs to know for `objects.ObjectStates.empty`.

    Args:
        dtype: Of its elements.
        shape: Of one row; nothing for one number per row.
    """
    return field(metadata={"empty": np.empty((0, *shape), dtype)})
