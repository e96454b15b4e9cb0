"""Export of continuous policies that answer alike on every processor: doubles inside, rounded outside; see `exact`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np
import torch
from gymnasium.spaces import Box, Dict, Discrete
from torch import Tensor, nn

from dohyo.agents.learning.policies.exact import DECIMALS
from dohyo.agents.learning.policies.export import Exportable, export, saved
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.files import write_atomically


def export_exact(policy: Exportable, spaces: tuple[Dict, Box | Discrete], path: Path, facts: Mapping[str, str]) -> None:
    """As `export`, with an ONNX model of `ExactPolicy`, whose actions are those of the weights, rounded as it says.

    Discrete policies are exported as they are: the best action is the best on every processor. What is no action of the
    space, such as the values of all options, is rounded to five decimals.

    Args:
        policy: See `export`.
        spaces: Of one observation, by name, and of one action.
        path: See `export`.
        facts: See `export`.
    """
    module, (seen, actions) = cast(nn.Module, policy), spaces
    zeros = {name: torch.zeros(1, *box.shape or (), dtype=_type_of(box)) for name, box in seen.spaces.items()}
    with torch.no_grad():
        answer = deepcopy(module).cpu().eval()(zeros)
    bounds = actions if isinstance(actions, Box) and actions.shape == answer.shape[1:] else None
    runs = ExactPolicy(module, bounds) if answer.is_floating_point() else policy
    export_running(policy, runs, seen, path, facts)


def export_running(policy: Exportable, runs: Exportable, space: Dict, path: Path, facts: Mapping[str, str]) -> None:
    """As `export`, with the weights of a policy as it is trained, and an ONNX model of what computes it.

    The same policy and facts give the same bytes.
    """
    weights = {name: one.detach().cpu().contiguous() for name, one in cast(nn.Module, policy).state_dict().items()}
    with TemporaryDirectory() as folder:
        made = Path(folder) / path.name
        export(runs, space, made, facts)
        model = f"{path.name}.onnx"
        write_atomically(path.with_name(model), made.with_name(model).read_bytes())  # first, see `export`
    write_atomically(path.with_name(f"{path.name}.safetensors"), saved(weights, {**policy.facts(), **facts}))


class ExactPolicy(nn.Module):
    """A policy of named observations with continuous actions, to be exported: doubles inside, rounded float32 outside.

    ONNX Runtime has no convolution of doubles, so that each is written as a product of matrices.
    """

    scale: Tensor
    low: Tensor | None
    high: Tensor | None

    def __init__(self, policy: nn.Module, actions: Box | None = None) -> None:
        """Copies the policy.

        Args:
            policy: See `export.Exportable`; its convolutions have neither groups nor dilation.
            actions: Space of its actions. They are rounded to its `decimals`, then clipped, since rounding may leave
                the bounds. None: five decimals and no bounds.
        """
        super().__init__()
        self.policy = of_doubles(policy)
        places = np.array(DECIMALS, np.float64) if actions is None else decimals(actions)
        self.register_buffer("scale", torch.from_numpy(np.asarray(10.0**places)))
        self.register_buffer("low", None if actions is None else torch.tensor(actions.low))
        self.register_buffer("high", None if actions is None else torch.tensor(actions.high))

    def facts(self) -> Mapping[str, str]:
        """See `export.Exportable`."""
        return cast(Exportable, self.policy).facts()

    def forward(self, observation: Mapping[str, Tensor]) -> Tensor:
        """(B, ...) by name -> (B, A) float32."""
        doubles = {name: one.double() if one.is_floating_point() else one for name, one in observation.items()}
        rounded: Tensor = (torch.round(self.policy(doubles) * self.scale) / self.scale).float()
        if self.low is None or self.high is None:
            return rounded
        return torch.minimum(torch.maximum(rounded, self.low), self.high)


def decimals(actions: Box) -> FloatArray:
    """(A,) decimals that actions are rounded to: 5, or more where 5 would leave less than 100,000 steps between bounds.

    Args:
        actions: With finite bounds, the lower one below the upper one.
    """
    width = actions.high.astype(np.float64) - actions.low.astype(np.float64)
    return DECIMALS + np.ceil(np.maximum(-np.log10(width), 0.0))


class _Products(nn.Module):
    """A convolution as the sum over its kernel's places of products of matrices."""

    def __init__(self, convolution: nn.Conv1d | nn.Conv2d) -> None:
        super().__init__()
        self.flat = isinstance(convolution, nn.Conv1d)
        weight, bias = convolution.weight, convolution.bias
        self.weight = nn.Parameter((weight[:, :, None] if self.flat else weight).detach())
        self.bias = None if bias is None else nn.Parameter(bias.detach())
        self.stride = (1, *convolution.stride)[-2:]
        self.dilation = (1, *convolution.dilation)[-2:]
        self.groups = convolution.groups
        self.padding = _sides(convolution.padding, self.weight.shape[-2:], self.dilation)
        self.padded = "constant" if convolution.padding_mode == "zeros" else convolution.padding_mode

    def forward(self, maps: Tensor) -> Tensor:
        """As the convolution."""
        planes = maps[:, :, None] if self.flat else maps
        if any(self.padding):
            planes = nn.functional.pad(planes, self.padding, mode=self.padded)
        parts = zip(planes.chunk(self.groups, 1), self.weight.chunk(self.groups), strict=True)
        out = torch.cat([self._product(part, weight) for part, weight in parts], dim=1)
        out = out if self.bias is None else out + self.bias[:, None, None]
        return out[:, :, 0] if self.flat else out

    def _product(self, planes: Tensor, weight: Tensor) -> Tensor:
        """(B, O, H, W) of (B, I, H', W') padded planes and (O, I, h, w) weights."""
        (down, right), (lower, wider) = self.stride, self.dilation
        tall, wide = weight.shape[-2:]
        height = (planes.shape[-2] - lower * (tall - 1) - 1) // down + 1
        width = (planes.shape[-1] - wider * (wide - 1) - 1) // right + 1
        rows, columns = down * (height - 1) + 1, right * (width - 1) + 1
        places = [
            planes[:, :, y : y + rows : down, x : x + columns : right].flatten(2)
            for y in range(0, lower * tall, lower)
            for x in range(0, wider * wide, wider)
        ]
        kernel = weight.permute(0, 2, 3, 1).flatten(1)
        out: Tensor = kernel @ torch.cat(places, dim=1)
        return out.reshape(-1, len(kernel), height, width)


def _sides(padding: str | Sequence[int], kernel: Sequence[int], dilation: Sequence[int]) -> tuple[int, int, int, int]:
    """Padding on the left, right, top and bottom; "same" puts what is odd on the right and at the bottom."""
    if isinstance(padding, str):
        whole = [0 if padding == "valid" else step * (size - 1) for size, step in zip(kernel, dilation, strict=True)]
        (top, bottom), (left, right) = ((one // 2, one - one // 2) for one in whole)
        return left, right, top, bottom
    top, left = (0, *padding)[-2:]
    return left, left, top, top


class _Normalisation(nn.Module):
    """A layer normalisation in plain operations: ONNX Runtime's own gives other digits than torch's."""

    def __init__(self, layer: nn.LayerNorm) -> None:
        super().__init__()
        self.weight, self.bias, self.epsilon = layer.weight, layer.bias, layer.eps
        self.over = tuple(range(-len(layer.normalized_shape), 0))

    def forward(self, values: Tensor) -> Tensor:
        """As the normalisation."""
        apart = values - values.mean(self.over, keepdim=True)
        out = apart / torch.sqrt((apart * apart).mean(self.over, keepdim=True) + self.epsilon)
        if self.weight is not None:
            out = out * self.weight
        return out if self.bias is None else out + self.bias


def of_doubles(module: nn.Module) -> nn.Module:
    """A copy in double precision, for evaluation on the processor, with convolutions that ONNX Runtime has."""
    return _with_products(deepcopy(module).cpu().double().eval())


def _with_products(module: nn.Module) -> nn.Module:
    """The module with its convolutions as products; every layer with weights takes doubles."""
    for name, child in module.named_children():
        replaced = _Products(child) if isinstance(child, nn.Conv1d | nn.Conv2d) else child
        setattr(module, name, _Normalisation(child) if isinstance(child, nn.LayerNorm) else _with_products(replaced))
    if any(True for _ in module.parameters(recurse=False)):
        module.register_forward_pre_hook(_double)
    return module


def _double(module: nn.Module, given: tuple[Any, ...]) -> tuple[Any, ...]:
    """Pictures come to the first layer in single precision, which divides them by 255."""
    return tuple(one.double() if isinstance(one, Tensor) and one.is_floating_point() else one for one in given)


def _type_of(box: Any) -> torch.dtype:
    return torch.uint8 if box.dtype == "uint8" else torch.float32
