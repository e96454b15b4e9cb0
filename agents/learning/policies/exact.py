"""Policies in double precision, rounded: the last digits of single precision depend on the processor's kernels.

A drive repeats every deviation of an action, so that records made in single precision verify on one kind of machine
only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor, nn

from dohyo.sumo_networks.arrays import Float32Array

DECIMALS: Final = 5
"""Two processors differ after the twelfth."""


def exact(module: nn.Module) -> Callable[[Float32Array], Float32Array]:
    """A network of vectors as a function of one: (O,) -> (A,), with numbers that are the same on every processor."""
    double = deepcopy(module).double().eval()

    @torch.no_grad()
    def answer(vector: Float32Array) -> Float32Array:
        numbers = double(torch.from_numpy(vector).double()[None])[0].numpy()
        return np.asarray(numbers.round(DECIMALS), dtype=np.float32)

    return answer


class ExactPolicy(nn.Module):
    """A policy of named observations with continuous actions, to be exported: doubles inside, rounded float32 outside.

    ONNX Runtime has no convolution of doubles, so that each is written as a product of matrices.
    """

    def __init__(self, policy: nn.Module) -> None:
        """Copies the policy.

        Args:
            policy: See `export.Exportable`; its convolutions have neither groups nor dilation.
        """
        super().__init__()
        self.policy = _of_doubles(deepcopy(policy).cpu().double().eval())

    def forward(self, observation: Mapping[str, Tensor]) -> Tensor:
        """(B, ...) by name -> (B, A) float32."""
        doubles = {name: one.double() if one.is_floating_point() else one for name, one in observation.items()}
        scale = 10.0**DECIMALS
        rounded: Tensor = torch.round(self.policy(doubles) * scale) / scale
        return rounded.float()


class _Products(nn.Module):
    """A convolution as the sum over its kernel's places of products of matrices."""

    def __init__(self, convolution: nn.Conv1d | nn.Conv2d) -> None:
        super().__init__()
        self.flat = isinstance(convolution, nn.Conv1d)
        weight, bias = convolution.weight, convolution.bias
        self.weight = nn.Parameter((weight[:, :, None] if self.flat else weight).detach())
        self.bias = None if bias is None else nn.Parameter(bias.detach())
        self.stride = (1, *convolution.stride)[-2:]
        padding = convolution.padding
        assert not isinstance(padding, str)
        self.padding = (0, *padding)[-2:]

    def forward(self, maps: Tensor) -> Tensor:
        """As the convolution."""
        planes = maps[:, :, None] if self.flat else maps
        (top, left), (down, right) = self.padding, self.stride
        planes = nn.functional.pad(planes, (left, left, top, top))
        tall, wide = self.weight.shape[-2:]
        height = (planes.shape[-2] - tall) // down + 1
        width = (planes.shape[-1] - wide) // right + 1
        places = [
            planes[:, :, y : y + down * (height - 1) + 1 : down, x : x + right * (width - 1) + 1 : right].flatten(2)
            for y in range(tall)
            for x in range(wide)
        ]
        kernel = self.weight.permute(0, 2, 3, 1).flatten(1)
        out: Tensor = kernel @ torch.cat(places, dim=1)
        out = out if self.bias is None else out + self.bias[:, None]
        return out if self.flat else out.reshape(-1, len(kernel), height, width)


def _of_doubles(module: nn.Module) -> nn.Module:
    """The module with its convolutions as products; every layer with weights takes doubles."""
    for name, child in module.named_children():
        plain = isinstance(child, nn.Conv1d | nn.Conv2d) and child.groups == 1 and set(child.dilation) == {1}
        setattr(module, name, _of_doubles(_Products(child) if plain else child))  # type: ignore[arg-type]
    if any(True for _ in module.parameters(recurse=False)):
        module.register_forward_pre_hook(_double)
    return module


def _double(module: nn.Module, given: tuple[Any, ...]) -> tuple[Any, ...]:
    """Pictures come to the first layer in single precision, which divides them by 255."""
    return tuple(one.double() if isinstance(one, Tensor) and one.is_floating_point() else one for one in given)
