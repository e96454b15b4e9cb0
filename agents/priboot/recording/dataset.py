"""Moments of drives, each seen from the ego's own pose and from displaced ones.

FOLDER/dataset.json                       what was ordered
FOLDER/SPLIT/NETWORK-NUMBER-EGO.npz       one ego's moments
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dohyo.agents.priboot.measurements import MEASUREMENTS
from dohyo.agents.priboot.view import HEIGHT, WIDTH
from dohyo.agents.shards import check_array, pack_shard, read_shard

SCHEMA_VERSION = 4
WAYPOINTS, WAYPOINT_S = 4, 0.5
VIEWS = 2
"""Of a moment: from the ego's own pose, and from a displaced one."""
SCHEMA = MappingProxyType(
    {
        "layers": ((VIEWS, HEIGHT, WIDTH), "uint16"),  # view.packed
        "measurements": ((VIEWS, MEASUREMENTS), "float32"),  # measurements.measured
        "waypoints": ((VIEWS, WAYPOINTS, 2), "float32"),  # m, in the frame of the view's pose
    }
)
"""Every array without its first axis: shape and dtype."""


@dataclass(frozen=True, slots=True)
class Moments:
    """N moments; the attributes are those of `SCHEMA`."""

    layers: NDArray[np.uint16]
    measurements: NDArray[np.float32]
    waypoints: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.layers)

    @classmethod
    def of(cls, rows: Sequence[tuple[Any, ...]]) -> Moments:
        """Packs moments, each a tuple in the order of `SCHEMA`."""
        columns = list(zip(*rows, strict=True)) or [()] * len(SCHEMA)
        return cls(
            *(
                np.array(column, dtype=dtype).reshape(len(rows), *shape)
                for column, (shape, dtype) in zip(columns, SCHEMA.values(), strict=True)
            )
        )

    def to_bytes(self) -> bytes:
        """Content of a shard."""
        return pack_shard(SCHEMA_VERSION, {name: getattr(self, name) for name in SCHEMA})


def load_shard(path: Path) -> Moments:
    """Reads and checks a shard.

    Raises:
        InvalidInputError: The file is missing, damaged, or of another schema.
    """
    arrays = read_shard(path, "priboot", SCHEMA_VERSION, set(SCHEMA))
    for name, (shape, dtype) in SCHEMA.items():
        check_array(path, "priboot", name, arrays[name], (len(arrays["layers"]), *shape), dtype)
    return Moments(**arrays)
