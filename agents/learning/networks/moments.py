"""Moments: running mean and deviation of observations, for their normalisation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

LEAST_SCALE = 0.05
"""Lower bound of the deviation, against large values of features that hardly change."""


class Moments:
    """Mean and variance of all rows so far, updated in batches (Chan et al. 1983).

    Attributes:
        count: Rows so far.
        mean: (O,) float64.
    """

    def __init__(self, size: int) -> None:
        """Begins without rows.

        Args:
            size: Numbers in a row, O.
        """
        self.count = 0
        self.mean = torch.zeros(size, dtype=torch.float64)
        self._squares = torch.zeros(size, dtype=torch.float64)

    @property
    def scale(self) -> Tensor:
        """(O,) standard deviation, at least 0.05; 1 as long as there is no row."""
        if not self.count:
            return torch.ones_like(self.mean)
        return (self._squares / self.count).sqrt().clamp_min(LEAST_SCALE)

    def add(self, rows: Tensor) -> None:
        """Adds (B, O) rows."""
        rows = rows.detach().cpu().double()
        count, mean = len(rows), rows.mean(dim=0)
        total, away = self.count + count, mean - self.mean
        self._squares += (rows - mean).square().sum(dim=0) + away.square() * (self.count * count / total)
        self.mean += away * (count / total)
        self.count = total

    def state(self) -> dict[str, Any]:
        """State for `restore`."""
        return {"count": self.count, "mean": self.mean, "squares": self._squares}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state."""
        self.count, self.mean, self._squares = state["count"], state["mean"].clone(), state["squares"].clone()
