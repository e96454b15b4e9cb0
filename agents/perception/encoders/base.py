"""Interface of an encoder, and the form of the pictures that it reads."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from dohyo.sumo_networks.errors import InvalidInputError

Shape = tuple[int, int, int]


class Encoder(nn.Module):
    """Pictures to a vector of features. A subclass computes `encode`.

    Attributes:
        shape: Channels, height and width of a picture, (C, H, W).
        features: Length of the vector, F.
    """

    def __init__(self, shape: Shape, features: int) -> None:
        super().__init__()
        self.shape, self.features = shape, features

    def forward(self, pictures: Tensor) -> Tensor:
        """(..., C, H, W) pictures to (..., F) features.

        Args:
            pictures: uint8, or float in [0, 1]; any number of axes before (C, H, W).

        Raises:
            InvalidInputError: The pictures have another shape or type.
        """
        if tuple(pictures.shape[-3:]) != self.shape:
            raise InvalidInputError(f"expected pictures of shape {self.shape}, got {tuple(pictures.shape)}")
        before = pictures.shape[:-3]
        return self.encode(as_float(pictures).reshape(-1, *self.shape)).reshape(*before, self.features)

    def encode(self, pictures: Tensor) -> Tensor:
        """(B, C, H, W) float pictures in [0, 1] to (B, F) features."""
        raise NotImplementedError


def as_float(pictures: Tensor) -> Tensor:
    """Pictures as float in [0, 1]: uint8 are divided by 255, float stay as they are.

    Raises:
        InvalidInputError: The pictures have another type.
    """
    if pictures.dtype == torch.uint8:
        return pictures.float() / 255.0
    if not pictures.is_floating_point():
        raise InvalidInputError(f"expected pictures in uint8, or in float within [0, 1], got {pictures.dtype}")
    return pictures
