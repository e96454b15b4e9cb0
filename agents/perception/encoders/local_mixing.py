"""A-LIX: adaptive local signal mixing, a layer against gradients that differ from one pixel to the next.

In training every feature map is shifted by one random part of a pixel or more, so that the gradient of a feature is
spread over its neighbours. The largest shift follows from the gradients themselves: it grows while neighbouring
gradients differ more than a target.

Source: Cetin et al. 2022, "Stabilizing Off-Policy Deep Reinforcement Learning from Pixels", algorithm 1 and equation 4;
numbers as in the authors' release.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor, nn
from torch.autograd.function import FunctionCtx
from torch.nn.functional import pad, unfold

REACH = 2.5
"""Shift of full strength, pixels (2 in the paper's text; half of 2 x 2 + 1 in its release)."""
SIDE = 35
"""Side of the smallest maps that the paper shifts, of pictures of 84 x 84."""
TARGET = 0.535
"""Discontinuity of gradients that the strength is tuned to."""
LEARNING_RATE, BETAS = 2e-3, (0.5, 0.999)
"""Of the strength, for Adam."""


class LocalMixing(nn.Module):
    """Random shift of feature maps with a tuned strength; the identity in evaluation.

    One layer serves all layers of an encoder: the strength is shared, and tuned at the last layer alone.

    Attributes:
        strength: Largest shift as a share of `reach`, in [0, 1]. Its gradient is no gradient of the loss; see
            `discontinuity`.
        reach: Shift of full strength, pixels.
        target: See `TARGET`.
        side: Maps that are smaller than this are shifted by the same share of their side, not by as many pixels.
    """

    def __init__(self, strength: float = 0.5, reach: float = REACH, target: float = TARGET, side: int = 1) -> None:
        super().__init__()
        self.strength = nn.Parameter(torch.tensor(strength))
        self.reach, self.target, self.side = reach, target, side

    def forward(self, maps: Tensor, tune: bool = False) -> Tensor:
        """Feature maps (B, C, H, W), shifted; the shift is the same for the batch and drawn from torch's generator.

        Args:
            maps: Feature maps.
            tune: Whether the gradient that comes back here gives the strength its own.
        """
        if not self.training:
            return maps
        with torch.no_grad():
            self.strength.clamp_(0.0, 1.0)
        furthest = self.reach * min(1.0, maps.shape[-1] / self.side) * self.strength.item()
        down, right = ((2.0 * torch.rand(2) - 1.0) * furthest).tolist()
        shifted = shift_maps(maps, down, right)
        if tune:
            shifted = _Tuning.apply(shifted, self.strength, self.target)  # type: ignore[no-untyped-call]
        return shifted


def shift_maps(maps: Tensor, down: float, right: float) -> Tensor:
    """Maps read `down` and `right` pixels away from each pixel: bilinear, with the border's values beyond the border.

    A product of matrices for the rows, and one for the columns, which leave the channels last.

    Args:
        maps: (B, C, H, W).
        down: Pixels.
        right: Pixels.
    """
    last = maps.permute(0, 2, 3, 1)
    batch, height, width, channels = last.shape
    rows, columns = _reading(height, down, maps).T, _reading(width, right, maps).T
    moved = rows @ last.reshape(batch, height, width * channels)
    moved = columns @ moved.view(batch * height, width, channels)
    return moved.view(last.shape).permute(0, 3, 1, 2)


def _reading(size: int, shift: float, like: Tensor) -> Tensor:
    """(size, size) weights of the pixels (rows) that each shifted pixel (column) reads."""
    pixels, whole = torch.arange(size, device=like.device), math.floor(shift)
    weights = like.new_zeros(size, size)
    for pixel, weight in ((pixels + whole, 1.0 - shift % 1.0), (pixels + whole + 1, shift % 1.0)):
        weights.index_put_((pixel.clamp(0, size - 1), pixels), like.new_tensor(weight), accumulate=True)
    return weights


def discontinuity(gradient: Tensor) -> Tensor:
    """How much the gradients of neighbouring features differ: 0 where they are equal, about 1 where they are noise.

    It is the mean over features of ln(1 + mean squared difference from the eight neighbours / their mean square).

    Args:
        gradient: (B, C, H, W) of a loss by feature maps; its mean over the batch counts.
    """
    mean = gradient.float().mean(0, keepdim=True).transpose(0, 1)
    around = unfold(pad(mean, (1, 1, 1, 1), "replicate"), 3)
    centre = mean.flatten(2)
    difference = (around - centre).square().sum(1, keepdim=True) / 8.0
    energy = (around.square().sum(1, keepdim=True) - centre.square()) / 8.0
    return torch.log1p(difference / (energy + 1e-20)).mean()


def parameter_groups(*networks: nn.Module) -> list[dict[str, Any]]:
    """Parameters of networks for torch's Adam: the strengths of A-LIX have a learning rate and betas of their own."""
    layers = [layer for network in networks for layer in network.modules() if isinstance(layer, LocalMixing)]
    strengths = {id(layer.strength): layer.strength for layer in layers}
    others = [p for network in networks for p in network.parameters() if id(p) not in strengths]
    tuned = {"params": list(strengths.values()), "lr": LEARNING_RATE, "betas": BETAS, "weight_decay": 0.0}
    return [{"params": others}, *([tuned] if strengths else [])]


class _Tuning(torch.autograd.Function):
    """Identity; its backward pass gives the strength a gradient, which raises it where gradients differ too much."""

    @staticmethod
    def forward(ctx: FunctionCtx, maps: Tensor, strength: Tensor, target: float) -> Tensor:
        ctx.target = target  # type: ignore[attr-defined]
        return maps.view_as(maps)

    @staticmethod
    def backward(ctx: FunctionCtx, *gradients: Tensor) -> tuple[Tensor, Tensor, None]:
        (gradient,) = gradients
        return gradient, ctx.target - discontinuity(gradient), None  # type: ignore[attr-defined]
