"""IMPALA's residual network.

Source: Espeholt et al. 2018, figure 3, the large network without its LSTM.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from dohyo.agents.perception.encoders.base import Encoder, Shape


class ImpalaEncoder(Encoder):
    """Three sections, each a convolution, a pooling that halves the sides, and two residual blocks; a linear layer."""

    def __init__(self, shape: Shape, features: int = 256, filters: tuple[int, ...] = (16, 32, 32)) -> None:
        """Draws weights from torch's generator.

        Args:
            shape: Of a picture, (C, H, W).
            features: Length of the output.
            filters: Channels of each section.
        """
        super().__init__(shape, features)
        channels, height, width = shape
        self.sections = nn.Sequential(
            *(_section(a, b) for a, b in zip((channels, *filters[:-1]), filters, strict=True))
        )
        for _ in filters:
            height, width = (height + 1) // 2, (width + 1) // 2
        self.linear = nn.Linear(filters[-1] * height * width, features)

    def encode(self, pictures: Tensor) -> Tensor:
        """(B, C, H, W) to (B, F), at least 0."""
        return torch.relu(self.linear(torch.relu(self.sections(pictures)).flatten(1)))


class _Residual(nn.Module):
    """Two convolutions, whose output is added to the input."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(channels, channels, 3, padding=1)
        self.second = nn.Conv2d(channels, channels, 3, padding=1)

    def forward(self, maps: Tensor) -> Tensor:
        out: Tensor = maps + self.second(torch.relu(self.first(torch.relu(maps))))
        return out


def _section(before: int, after: int) -> nn.Sequential:
    pooling = nn.MaxPool2d(3, stride=2, padding=1)
    return nn.Sequential(nn.Conv2d(before, after, 3, padding=1), pooling, _Residual(after), _Residual(after))
