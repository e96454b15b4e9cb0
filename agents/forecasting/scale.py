"""Scale: between metres per second and what a network reads, speeds with mean 0 and standard deviation 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from dohyo.agents.forecasting.windows import Windows
from dohyo.sumo_networks.arrays import Float32Array

LEAST_SPREAD_MPS = 0.1


@dataclass(frozen=True, slots=True)
class Scale:
    """Centre and spread of the speeds learned from, one of each for all segments, so that jams stay where they are.

    Attributes:
        centre_mps: What a network reads as 0.
        spread_mps: What it reads as 1 more.
    """

    centre_mps: float = 0.0
    spread_mps: float = 1.0

    @classmethod
    def of(cls, windows: Windows) -> Scale:
        """That of some windows."""
        return cls(float(windows.history.mean()), max(float(windows.history.std()), LEAST_SPREAD_MPS))

    def standard(self, speeds: Float32Array) -> Tensor:
        """Speeds in m/s as a tensor that a network reads."""
        flat = np.ascontiguousarray(speeds, dtype=np.float32)
        return (torch.from_numpy(flat) - self.centre_mps) / self.spread_mps

    def metres(self, standard: Tensor) -> Float32Array:
        """Back."""
        return np.asarray((standard * self.spread_mps + self.centre_mps).numpy(), dtype=np.float32)

    def facts(self) -> dict[str, str]:
        """For a file."""
        return {"centre_mps": repr(self.centre_mps), "spread_mps": repr(self.spread_mps)}


class InMetres(nn.Module):
    """A network between metres per second, for one history (8, N); forecasts are not below 0.

    Attributes:
        network: Between standardised speeds.
        scale: Of these.
    """

    def __init__(self, network: nn.Module, scale: Scale) -> None:
        super().__init__()
        self.network, self.scale = network, scale

    def forward(self, history: Tensor) -> Tensor:
        """What the network gives of one history, (3, N) or (3, 3, N)."""
        standard = (history[None] - self.scale.centre_mps) / self.scale.spread_mps
        out: Tensor = self.network(standard)[0] * self.scale.spread_mps + self.scale.centre_mps
        return out.clamp_min(0.0)
