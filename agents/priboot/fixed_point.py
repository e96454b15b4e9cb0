"""The network in numbers that are the same on every processor: a trunk in fixed point, and a head in doubles.

Kernels of single precision add in an order of their own, and a drive repeats every last digit in which they differ.
Doubles, rounded at the end, would do (see `learning/policies/exact_export`). But ONNX Runtime has no convolution of
doubles, and written as products the network took 32 ms instead of 6 (a trial). In fixed point every sum is a whole
number of units below 2^24. Single precision adds these exactly in any order, so that the same fast kernels do.

Source: Jacob et al. 2018 for whole numbers between layers; ours are powers of two and not of eight bits.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final, cast

import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from dohyo.agents.learning.policies.exact import DECIMALS
from dohyo.agents.learning.policies.exact_export import of_doubles
from dohyo.agents.perception.encoders.base import as_float
from dohyo.agents.perception.encoders.efficientnet import Convolution, same_padded
from dohyo.agents.priboot.network import Priboot, Trunk, before_ego

EXACT: Final = 2.0**24
"""Whole numbers up to this are exact in single precision."""
PIXEL_BITS, WIDE_BITS, NARROW_BITS = 7, 7, 5
"""Binary digits behind the point of pixels, of what ReLU6 bounds, and of what is linear."""
NARROW: Final = 128.0
"""Bound of what is linear; town and city views have 70."""


class ExactPriboot(nn.Module):
    """A policy as `Priboot`, whose waypoints do not depend on the order of any sum."""

    def __init__(self, network: Priboot) -> None:
        """Converts a copy of the weights."""
        super().__init__()
        trunk = network.trunk
        self.trunk = FixedPointTrunk(trunk) if isinstance(trunk, Trunk) else of_doubles(trunk)
        self.head, self.kind = of_doubles(network.head), network.kind

    def forward(self, observation: Mapping[str, Tensor]) -> Tensor:
        """(B, ...) picture in uint8 and measurements -> (B, 8) waypoints [m], float32 to five decimals."""
        picture, measurements = observation["picture"], observation["measurements"]
        maps: Tensor = self.trunk(picture).double()
        waypoints: Tensor = self.head(maps, before_ego(as_float(picture)), measurements.double())[0]
        scale = 10.0**DECIMALS
        return (torch.round(waypoints.flatten(1) * scale) / scale).float()

    def facts(self) -> Mapping[str, str]:
        """As `Priboot`."""
        return {"picture": self.kind}


class FixedPointTrunk(nn.Module):
    """(B, 3, 160, 128) uint8 to (B, 8960) maps, all whole numbers divided by 2^5."""

    def __init__(self, trunk: Trunk) -> None:
        super().__init__()
        stem, *blocks = trunk.layers
        self.stem = FixedPointConvolution(cast(Convolution, stem), (PIXEL_BITS, 1.0), WIDE_BITS)
        self.blocks = nn.ModuleList(_Block(block) for block in blocks)

    def forward(self, pictures: Tensor) -> Tensor:
        """See the class."""
        maps: Tensor = self.stem(pictures.float() - 127.0)
        for block in self.blocks:
            maps = block(maps)
        return maps.flatten(1) / 2.0**NARROW_BITS


class _Block(nn.Module):
    """An inverted residual."""

    def __init__(self, block: nn.Module) -> None:
        super().__init__()
        *wide, last = cast(Iterable[Convolution], block.layers)
        given = [(NARROW_BITS, NARROW) if index == 0 and len(wide) > 1 else (WIDE_BITS, 6.0) for index in range(2)]
        layers = [FixedPointConvolution(one, at, WIDE_BITS) for one, at in zip(wide, given, strict=False)]
        self.layers = nn.Sequential(*layers, FixedPointConvolution(last, (WIDE_BITS, 6.0), NARROW_BITS))
        self.residual = bool(block.residual)

    def forward(self, maps: Tensor) -> Tensor:
        added: Tensor = self.layers(maps)
        bound = NARROW * 2.0**NARROW_BITS
        return (maps + added).clamp(-bound, bound) if self.residual else added


class FixedPointConvolution(nn.Module):
    """A convolution, its normalisation and ReLU6 from whole numbers to whole numbers.

    The weights of each channel are multiples of a power of two, the smallest with which no sum of some of its products
    can leave what is exact.
    """

    def __init__(self, layer: Convolution, given: tuple[int, float], bits: int) -> None:
        """Rounds the weights.

        Args:
            layer: In evaluation.
            given: Binary digits behind the point of what it reads, and its bound; that of ReLU6 has no sign.
            bits: Binary digits behind the point of what it returns.
        """
        super().__init__()
        fused = fuse_conv_bn_eval(layer.convolution, layer.norm)
        before, bound = given
        weight = fused.weight.detach().double() * 2.0 ** (bits - before)
        bias = cast(Tensor, fused.bias).detach().double() * 2.0**bits
        largest = bound * 2.0**before
        signed, linear = bound != 6.0, isinstance(layer.activation, nn.Identity)
        unit = _unit(weight, bias, largest, signed)
        self.weight = nn.Parameter(_rounded(weight, unit[:, None, None, None]).float())
        self.bias = nn.Parameter(_rounded(bias, unit).float())
        assert bool((_reached(self.weight.double(), largest, signed) + self.bias.abs() <= EXACT * unit).all())
        self.kernel, self.stride, self.groups = fused.kernel_size[0], fused.stride[0], fused.groups
        self.high = (NARROW if linear else 6.0) * 2.0**bits
        self.low = -self.high if linear else 0.0

    def forward(self, maps: Tensor) -> Tensor:
        """(B, C, H, W) whole numbers to such."""
        padded = same_padded(maps, self.kernel, self.stride)
        summed = nn.functional.conv2d(padded, self.weight, self.bias, self.stride, groups=self.groups)
        return torch.round(summed.clamp(self.low, self.high))


def _reached(weight: Tensor, largest: float, signed: bool) -> Tensor:
    """(C,) bound of every sum of some products of a channel."""
    rows = weight.flatten(1)
    return (rows.abs().sum(1) if signed else torch.maximum(rows.relu().sum(1), (-rows).relu().sum(1))) * largest


def _unit(weight: Tensor, bias: Tensor, largest: float, signed: bool) -> Tensor:
    """(C,) the power of two whose multiples the weights of a channel become."""
    slack = weight[0].numel() * largest / 2.0  # what rounding can add, in units
    reached = _reached(weight, largest, signed) + bias.abs()
    least = torch.finfo(torch.float32).tiny  # of a channel without weights
    return torch.exp2(torch.ceil(torch.log2(reached.clamp(min=least) / (EXACT - slack - 1.0))))


def _rounded(values: Tensor, unit: Tensor) -> Tensor:
    return torch.round(values / unit) * unit
