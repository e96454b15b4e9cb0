"""What the head reads of the pictures: feature maps, and the pixels before the ego.

The maps of a frozen trunk are computed once, and kept in half precision beside the demonstrations. Where the trunk
learns, the pictures are unpacked for every batch.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dohyo.agents.perception.drives import Column
from dohyo.agents.perception.encoders.base import as_float
from dohyo.agents.perception.feature_cache import cached_features
from dohyo.agents.priboot.network import CompiledTrunk, Priboot, before_ego
from dohyo.agents.priboot.training.views import Compressed, Pictures, Split
from dohyo.agents.priboot.view import colours_of, masks_of

FEATURES = "features"
"""Folder of the cached feature maps, in that of the demonstrations."""

Seen = Callable[[Tensor], tuple[Tensor, Tensor]]
"""Rows of the pictures -> (B, 8960) feature maps, and (B, L, 112, 32) pixels before the ego in [0, 1]."""


def seen_of(network: Priboot, folder: Path, moments: Split) -> Seen:
    """What the head of a network reads, with the cache in the folder of the demonstrations."""
    learns = any(parameter.requires_grad for parameter in network.trunk.parameters())
    return _learned(network, moments) if learns else _cached(folder, moments)


def _learned(network: Priboot, moments: Split) -> Seen:
    """Maps of the trunk as it is at every step."""
    layers = Compressed(moments.paths)
    unpacked = masks_of if network.kind == "masks" else colours_of
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def seen(rows: Tensor) -> tuple[Tensor, Tensor]:
        pictures = as_float(torch.from_numpy(unpacked(layers[rows.numpy()])))
        pictures = pictures.contiguous(memory_format=torch.channels_last)
        return network.trunk(pictures), before_ego(pictures)

    return seen


def _cached(folder: Path, moments: Split) -> Seen:
    """Maps of the frozen trunk, and what is before the ego, in memory."""
    # A copy of each, since a view of what is before the ego keeps the whole picture in memory.
    before = np.concatenate([before_ego(Pictures(path).layers).copy() for path in moments.paths])
    maps = cached_maps(folder / FEATURES, moments.paths)

    def seen(rows: Tensor) -> tuple[Tensor, Tensor]:
        numbers = rows.numpy()
        return torch.from_numpy(maps[numbers]).float(), as_float(torch.from_numpy(colours_of(before[numbers])))

    return seen


def cached_maps(folder: Path, paths: list[Path], tell: Callable[[Path], None] = lambda path: None) -> Column:
    """Feature maps of the frozen trunk over shards, computed where the folder does not hold them."""
    trunk, parts = _compiled_trunk(), []
    for path in paths:
        parts.append(cached_features(trunk, Pictures(path), folder, dtype=np.float16))
        tell(path)
    return Column(parts, np.cumsum([0, *(len(part) for part in parts)]), "")


@cache
def _compiled_trunk() -> CompiledTrunk:
    """The trunk, which takes more than a second to compile."""
    return CompiledTrunk()
