"""Laplacian pyramid over the segments of a road, and the loss that compares two of them level by level.

Level j of a pyramid of depth n is what the j-th blurring removes; level n is the rest. The kernel is Burt and
Adelson's binomial one, (1, 4, 6, 4, 1) / 16. Segments are padded with zeros to a multiple of 2^n, because each level
halves them: 21 become 22, 24, 24 and 32 for n = 1 to 4. Source: thesis A, section 6.4.1; Ling and Okada 2006.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

KERNEL = (1.0, 4.0, 6.0, 4.0, 1.0)
MAX_DEPTH = 4


def padded_length(segments: int, depth: int) -> int:
    """The next multiple of 2^depth."""
    size: int = 2**depth
    return -(-segments // size) * size


def pyramid(speeds: Tensor, depth: int) -> list[Tensor]:
    """Levels 0 (finest) to depth (the rest).

    Args:
        speeds: (..., N).
        depth: Number of halvings; 0 gives the speeds themselves.

    Returns:
        depth + 1 tensors; level j is (..., P / 2^j) for the padded length P.
    """
    rest = functional.pad(speeds, (0, padded_length(speeds.shape[-1], depth) - speeds.shape[-1]))
    levels = []
    for _ in range(depth):
        smaller = _blurred(rest)[..., ::2]
        levels.append(rest - expand(smaller))
        rest = smaller
    return [*levels, rest]


def reconstruct(levels: list[Tensor], segments: int) -> Tensor:
    """The speeds (..., N) that have these levels."""
    *fine, rest = levels
    for level in reversed(fine):
        rest = level + expand(rest)
    return rest[..., :segments]


def expand(speeds: Tensor) -> Tensor:
    """(..., 2 P) twice as many segments: zeros between them, blurred, doubled."""
    apart = torch.stack([speeds, torch.zeros_like(speeds)], dim=-1).flatten(-2)
    weight = _blurred(torch.stack([torch.ones_like(speeds), torch.zeros_like(speeds)], dim=-1).flatten(-2))
    return _blurred(apart) / weight  # 1/2 inside; at the ends it keeps constants constant


def _blurred(speeds: Tensor) -> Tensor:
    """(..., P) mean by the kernel; zero beyond the ends, like the padding."""
    kernel = speeds.new_tensor(KERNEL)[None, None] / sum(KERNEL)
    return functional.conv1d(speeds.reshape(-1, 1, speeds.shape[-1]), kernel, padding=2).reshape(speeds.shape)


class LaplacianLoss(nn.Module):
    """Lap_n(x, x') = sum over j of 4^j |L^j(x) - L^j(x')|_1 / N, the mean over all but the segments.

    The thesis does not say how the sum is scaled against the squared error; here both are per segment. A pyramid is
    linear, so the levels of a difference are one matrix times it.

    Attributes:
        levels: (N, sum of the levels' lengths) that matrix, with the weights 4^j / N.
    """

    levels: Tensor

    def __init__(self, segments: int, depth: int) -> None:
        super().__init__()
        parts = [4.0**j * level for j, level in enumerate(pyramid(torch.eye(segments), depth))]
        self.register_buffer("levels", torch.cat(parts, dim=-1) / segments, persistent=False)

    def forward(self, difference: Tensor) -> Tensor:
        """The loss of differences x - x' (..., N)."""
        return (difference @ self.levels).abs().sum(-1).mean()
