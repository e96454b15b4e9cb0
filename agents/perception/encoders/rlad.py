"""RLAD's image encoder: nine small convolutions, each followed by A-LIX.

Source: Coelho 2024, table 3.1 (0.63 million parameters at 9 x 256 x 256; RLfOLD has the same with 6 channels). Weights
are delta-orthogonal (Xiao et al. 2018) and orthogonal, section 4.3. For smaller pictures, fewer layers are ours.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from dohyo.agents.perception.convolutions import convolved
from dohyo.agents.perception.encoders.base import Encoder, Shape
from dohyo.agents.perception.encoders.local_mixing import SIDE, LocalMixing

KERNEL = 3
"""Side of a kernel; at a longer stride it is a pixel longer than the stride, so that no pixel is left out."""
THESIS = ((32, 2), (32, 2), (32, 2), (64, 2), (64, 1), (64, 1), (64, 1), (64, 1), (64, 1))
"""Channels and stride of each convolution, for pictures of 256 x 256."""
SMALL = ((32, 2), (32, 2), (64, 2), (64, 1), (64, 1))
"""The same for pictures of 64 x 64 and 84 x 84: 3 x 3 and 5 x 5 pixels are left, as 5 x 5 are of 256 x 256."""
THESIS_SIDE = 223
"""Smallest side of which `THESIS` leaves 3 x 3 pixels."""


class RladEncoder(Encoder):
    """Pictures, or some of them stacked in their channels, to features in [-1, 1].

    Attributes:
        mixing: A-LIX, shared by all layers, or None. `local_mixing.parameter_groups` gives its strength the learning
            rate it needs.
    """

    def __init__(
        self,
        shape: Shape,
        features: int = 256,
        layers: tuple[tuple[int, int], ...] | None = None,
        mixed: bool = True,
        scaled: bool = False,
    ) -> None:
        """Draws weights from torch's generator.

        Args:
            shape: Of a picture, (C, H, W).
            features: Length of the output.
            layers: Channels and stride of each convolution; None: `THESIS` where the pictures are large enough for
                it, else `SMALL`.
            mixed: Whether A-LIX follows every convolution.
            scaled: Whether it shifts small maps by the same share of their side as those of its source, see `SIDE`.

        Raises:
            InvalidInputError: The pictures are too small for the layers.
        """
        super().__init__(shape, features)
        layers = layers or (THESIS if min(shape[1:]) >= THESIS_SIDE else SMALL)
        channels, height, width = shape
        self.convolutions = nn.ModuleList()
        for filters, stride in layers:
            kernel = max(KERNEL, stride + 1)
            self.convolutions.append(nn.Conv2d(channels, filters, kernel, stride))
            channels, height, width = filters, convolved(height, kernel, stride), convolved(width, kernel, stride)
        self.mixing = LocalMixing(side=SIDE if scaled else 1) if mixed else None
        self.linear = nn.Sequential(nn.Linear(channels * height * width, features), nn.LayerNorm(features), nn.Tanh())
        self.apply(initialise)
        self.convolutions.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # a third faster

    def encode(self, pictures: Tensor) -> Tensor:
        """(B, C, H, W) to (B, F) in [-1, 1]."""
        maps = (pictures - 0.5).contiguous(memory_format=torch.channels_last)
        for number, convolution in enumerate(self.convolutions, start=1):
            maps = torch.relu(convolution(maps))
            if self.mixing is not None:
                maps = self.mixing(maps, tune=number == len(self.convolutions))
        features: Tensor = self.linear(maps.flatten(1))
        return features


def initialise(layer: nn.Module) -> None:
    """Delta-orthogonal convolutions, orthogonal linear layers, no bias; for `nn.Module.apply`.

    A delta-orthogonal kernel is 0 but for its middle, an orthogonal matrix: the convolution keeps the signal's norm.
    """
    if isinstance(layer, nn.Linear):
        nn.init.orthogonal_(layer.weight)
        nn.init.zeros_(layer.bias)
    elif isinstance(layer, nn.Conv2d):
        nn.init.zeros_(layer.weight)
        down, right = (side // 2 for side in layer.kernel_size)
        nn.init.orthogonal_(layer.weight.data[:, :, down, right], nn.init.calculate_gain("relu"))
        if layer.bias is not None:
            nn.init.zeros_(layer.bias)
