"""Moments: a recorded split in memory, as tensors."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dohyo.agents.perception.drives import Drives
from dohyo.sumo_networks.arrays import IntArray
from dohyo.sumo_networks.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Moments:
    """N moments of one split.

    Attributes:
        pictures: (N, 3, 3, 64, 64) uint8 by camera.
        classes: (N, 3, 64, 64) uint8 `hierarchical.vision.classes.Seen`.
        displacement: (N, 6) float32, see `cameras`.
        junction: (N,) int64, 1 if a junction is ahead.
        light: (N,) int64, 0 for none, then red, yellow, green.
        distance_m: (N,) float32 to the light; 0 without one.
        angle_rad: (N,) float32 to the lane.
        offset_m: (N,) float32 from the lane's middle.
    """

    pictures: Tensor
    classes: Tensor
    displacement: Tensor
    junction: Tensor
    light: Tensor
    distance_m: Tensor
    angle_rad: Tensor
    offset_m: Tensor

    def __len__(self) -> int:
        return len(self.pictures)

    @classmethod
    def of(cls, drives: Drives) -> Moments:
        """All moments of drives.

        Raises:
            InvalidInputError: The drives hold other arrays.
        """
        names = [field.name for field in fields(cls)]
        if missing := [name for name in names if name not in drives.drives[0].arrays]:
            raise InvalidInputError(f"expected drives of `dohyo dataset affordances`, without '{missing[0]}' they are")
        read = {name: torch.from_numpy(drives.column(name)[np.arange(len(drives))]) for name in names}
        return cls(**read | {name: read[name].long() for name in ("junction", "light")})

    @classmethod
    def load(cls, folder: Path, split: str) -> Moments:
        """All moments of a split.

        Raises:
            InvalidInputError: There are none, or they hold other arrays.
        """
        return cls.of(Drives(folder, split))

    def rows(self, index: Tensor | IntArray, device: str | torch.device = "cpu") -> Moments:
        """Selected moments."""
        chosen = torch.as_tensor(index)
        return Moments(*(getattr(self, field.name)[chosen].to(device) for field in fields(self)))
