"""Scale: between metres per second and a network's speeds with mean 0 and standard deviation 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from dohyo.agents.forecasting.data.windows import Windows
from dohyo.sumo_networks.arrays import Float32Array

LEAST_SPREAD_MPS = 0.1


@dataclass(frozen=True, slots=True)
class Scale:
    """Centre and spread of the speeds learned from, one of each for all segments.

    Attributes:
        centre_mps: Speed with the value 0.
        spread_mps: Difference of speed with the value 1.
    """

    centre_mps: float = 0.0
    spread_mps: float = 1.0

    @classmethod
    def of(cls, windows: Windows) -> Scale:
        """Scale of some windows."""
        return cls(float(windows.history.mean()), max(float(windows.history.std()), LEAST_SPREAD_MPS))

    def standard(self, speeds: Float32Array) -> Tensor:
        """Standardised tensor of speeds in m/s."""
        flat = np.ascontiguousarray(speeds, dtype=np.float32)
        return (torch.from_numpy(flat) - self.centre_mps) / self.spread_mps

    def metres(self, standard: Tensor) -> Float32Array:
        """Speeds in m/s of a standardised tensor."""
        return np.asarray((standard * self.spread_mps + self.centre_mps).numpy(), dtype=np.float32)

    def facts(self) -> dict[str, str]:
        """Values for a file."""
        return {"centre_mps": repr(self.centre_mps), "spread_mps": repr(self.spread_mps)}


class InMetres(nn.Module):
    """Network with input and output in m/s, for one history (8, N); forecasts are not below 0.

    Attributes:
        network: Between standardised speeds.
        scale: Of these.
    """

    def __init__(self, network: nn.Module, scale: Scale) -> None:
        super().__init__()
        self.network, self.scale = network, scale

    def forward(self, history: Tensor) -> Tensor:
        """Output of the network for one history, (3, N) or (3, 3, N)."""
        standard = (history[None] - self.scale.centre_mps) / self.scale.spread_mps
        out: Tensor = self.network(standard)[0] * self.scale.spread_mps + self.scale.centre_mps
        return out.clamp_min(0.0)
