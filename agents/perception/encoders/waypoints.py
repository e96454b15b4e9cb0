"""WayConv1D: the route's next points, read by a convolution over pairs of neighbouring points.

Source: Coelho 2024, section 3.3.2; widths as in the author's release.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from dohyo.agents.perception.encoders.rlad import initialise

KERNEL = 2


class WayConv1D(nn.Module):
    """(N, 2) points in the ego frame to features in [-1, 1].

    Attributes:
        features: Length of the output, F.
    """

    def __init__(self, points: int = 10, features: int = 32, hidden: int = 20) -> None:
        """Draws weights from torch's generator.

        Args:
            points: Number of points, N, at least 2.
            features: Length of the output.
            hidden: Channels of the convolution, and width of the hidden layer.
        """
        super().__init__()
        self.features = features
        self.convolution = nn.Conv1d(2, hidden, KERNEL)
        self.linear = nn.Sequential(
            *(nn.Linear(hidden * (points - KERNEL + 1), hidden), nn.LayerNorm(hidden), nn.ReLU()),
            *(nn.Linear(hidden, features), nn.LayerNorm(features), nn.Tanh()),
        )
        self.apply(initialise)

    def forward(self, points: Tensor) -> Tensor:
        """(..., N, 2) points to (..., F) features."""
        flat = points.reshape(-1, *points.shape[-2:])
        features: Tensor = self.linear(torch.relu(self.convolution(flat.transpose(1, 2))).flatten(1))
        return features.reshape(*points.shape[:-2], self.features)
