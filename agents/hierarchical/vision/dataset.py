"""Semantic dataset: pictures with their labels, in shards of one episode each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dohyo.agents.hierarchical.vision.classes import HEIGHT, WIDTH
from dohyo.agents.shards import check_array, find_shards, pack_shard, read_shard
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.rendering.labels import Label

SCHEMA_VERSION = 1
SCHEMA = MappingProxyType(
    {
        "pictures": ((HEIGHT, WIDTH), "uint8"),  # imaging.labels.Label
        "impact_m": ((), "float32"),  # see nearby.distances
        "event_m": ((), "float32"),
        "signal": ((), "int8"),  # of the next junction, world.LightState; -1 without
        "mounting": ((6,), "float32"),  # x, y, z [m], yaw, pitch, roll [deg] off the camera's own
    }
)
"""Every array without its first axis: shape and dtype."""


@dataclass(frozen=True, slots=True)
class Pictures:
    """N pictures with their labels; the attributes are those of `SCHEMA`."""

    pictures: NDArray[np.uint8]
    impact_m: NDArray[np.float32]
    event_m: NDArray[np.float32]
    signal: NDArray[np.int8]
    mounting: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.pictures)

    @classmethod
    def of(cls, rows: Sequence[tuple[Any, ...]]) -> Pictures:
        """Packs pictures, each a tuple in the order of `SCHEMA`."""
        columns = list(zip(*rows, strict=True)) or [()] * len(SCHEMA)
        return cls(
            *(
                np.array(column, dtype=dtype).reshape(len(rows), *shape)
                for column, (shape, dtype) in zip(columns, SCHEMA.values(), strict=True)
            )
        )

    @classmethod
    def joined(cls, parts: Sequence[Pictures]) -> Pictures:
        """Concatenates several."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in SCHEMA))

    def to_bytes(self) -> bytes:
        """Bytes of the file; the same pictures give the same bytes."""
        return pack_shard(SCHEMA_VERSION, {name: getattr(self, name) for name in SCHEMA})


def load_shard(path: Path) -> Pictures:
    """Reads a shard.

    Raises:
        InvalidInputError: The file is missing, damaged, or of another schema.
    """
    arrays = read_shard(path, "semantic", SCHEMA_VERSION, set(SCHEMA))
    size = len(np.atleast_1d(arrays["impact_m"]))
    for name, (shape, dtype) in SCHEMA.items():
        check_array(path, "semantic", name, arrays[name], (size, *shape), dtype)
    if size and int(arrays["pictures"].max()) >= len(Label):
        raise InvalidInputError(f"semantic shard '{path}': a picture holds a label above {len(Label) - 1}")
    return Pictures(**arrays)


def load_split(folder: Path, split: str) -> Pictures:
    """All pictures of one split ("train", "validation", "test"), in memory: 13 kB each.

    Raises:
        InvalidInputError: There are none.
    """
    return Pictures.joined([load_shard(path) for path in find_shards(folder, split, "semantic")])
