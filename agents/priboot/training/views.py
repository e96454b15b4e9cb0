"""Views of a dataset: every different picture once, with the measurements and waypoints that belong to it."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, from_numpy

from dohyo.agents.priboot.measurements import TARGET
from dohyo.agents.priboot.recording.dataset import Moments, load_shard
from dohyo.agents.priboot.view import HEIGHT, WIDTH, colours_of
from dohyo.agents.shards import find_shards
from dohyo.sumo_networks.arrays import IntArray
from dohyo.sumo_networks.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Split:
    """M moments of a split, without their pictures.

    Attributes:
        row: (M, V) number of each view's picture among those of all `paths`.
        measurements: (M, V, 11).
        waypoints: (M, V, 4, 2) m.
        drive: (M,) number of the drive.
        paths: Shards, one per drive.
    """

    row: Tensor
    measurements: Tensor
    waypoints: Tensor
    drive: IntArray
    paths: list[Path]

    def __len__(self) -> int:
        return len(self.row)


class Pictures:
    """The different pictures of one shard as colours, unpacked when they are asked for.

    Attributes:
        digest: Names the values.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.digest = f"colours {hashlib.sha256(path.read_bytes()).hexdigest()}"

    def __len__(self) -> int:
        return len(self.layers)

    def __getitem__(self, rows: slice) -> NDArray[np.uint8]:
        """(N, 3, 160, 128) some pictures."""
        return colours_of(self.layers[rows])

    @cached_property
    def layers(self) -> NDArray[np.uint16]:
        """(R, 160, 128) packed layers of all of them."""
        shard = load_shard(self._path)
        return shard.layers[_different(shard)]


class Compressed:
    """Packed layers of all different pictures of some shards, in memory in a thirtieth of their 41 kB each."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self._pictures = [zlib.compress(picture, 1) for path in paths for picture in Pictures(path).layers]

    def __len__(self) -> int:
        return len(self._pictures)

    def __getitem__(self, rows: IntArray) -> NDArray[np.uint16]:
        """(N, 160, 128) some of them."""
        unpacked = b"".join(zlib.decompress(self._pictures[row]) for row in rows)
        return np.frombuffer(unpacked, np.uint16).reshape(len(rows), HEIGHT, WIDTH)


def load_split(folder: Path, split: str, added: Sequence[Path] = ()) -> Split:
    """Moments of "train" or "validation" of a folder, and of others that come to it.

    Raises:
        InvalidInputError: There are no moments, or a shard is damaged.
    """
    paths: list[Path] = []
    rows, measurements, waypoints, drives = [], [], [], []
    pictures = 0
    for path in (path for one in (folder, *added) for path in find_shards(one, split, "priboot")):
        shard = load_shard(path)
        if not len(shard):
            continue
        different = _different(shard)
        number = np.cumsum(different.reshape(-1)).reshape(different.shape) - 1
        rows.append(np.where(different, number, number[:, :1]) + pictures)
        pictures += int(different.sum())
        measurements.append(shard.measurements)
        waypoints.append(shard.waypoints)
        drives.append(np.full(len(shard), len(paths)))
        paths.append(path)
    if not paths:
        raise InvalidInputError(f"expected moments in the shards of '{folder / split}', found none")
    row, measured, points = (from_numpy(np.concatenate(column)) for column in (rows, measurements, waypoints))
    return Split(row, measured, points, np.concatenate(drives), paths)


def _different(shard: Moments) -> NDArray[np.bool_]:
    """(M, V) whether a view has a picture of its own: one that is not displaced shows the moment's first."""
    targets = shard.measurements[:, :, TARGET]
    out: NDArray[np.bool_] = (targets != targets[:, :1]).any(axis=2)
    out[:, 0] = True
    return out
