"""Transformer over time, and TSMixer, which mixes minutes and segments by perceptrons.

Sources: Vaswani et al. 2017 (the encoder, norm first); Chen et al. 2023.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from dohyo.agents.forecasting.data.windows import HISTORY

WIDTH, HEADS, LAYERS = 64, 4, 2
BLOCKS, MIXER_WIDTH = 2, 64


class TransformerTrunk(nn.Module):
    """Tokens are the minutes; the result is the last token.

    Attributes:
        features: Width of the output.
    """

    def __init__(self, segments: int) -> None:
        super().__init__()
        self.features = WIDTH
        self.inward = nn.Linear(segments, WIDTH)
        self.position = nn.Parameter(0.02 * torch.randn(HISTORY, WIDTH))
        self.blocks = nn.ModuleList(AttentionBlock() for _ in range(LAYERS))
        self.norm = nn.LayerNorm(WIDTH)

    def forward(self, history: Tensor, state: None = None) -> tuple[Tensor, None]:
        """Reads a history (B, s, N); gives (B, WIDTH)."""
        tokens = self.inward(history) + self.position
        for block in self.blocks:
            tokens = block(tokens)
        return self.norm(tokens[:, -1]), None


class AttentionBlock(nn.Module):
    """(B, L, WIDTH) tokens: attention among them, then a perceptron, each with a residual connection."""

    def __init__(self) -> None:
        super().__init__()
        self.first, self.second = nn.LayerNorm(WIDTH), nn.LayerNorm(WIDTH)
        self.inward, self.outward = nn.Linear(WIDTH, 3 * WIDTH), nn.Linear(WIDTH, WIDTH)
        self.perceptron = nn.Sequential(nn.Linear(WIDTH, 2 * WIDTH), nn.GELU(), nn.Linear(2 * WIDTH, WIDTH))

    def forward(self, tokens: Tensor) -> Tensor:
        """See the class."""
        batch, count, _ = tokens.shape
        parts = self.inward(self.first(tokens)).view(batch, count, 3, HEADS, WIDTH // HEADS)
        query, key, value = parts.permute(2, 0, 3, 1, 4).unbind(0)
        weights = torch.softmax(query @ key.transpose(2, 3) / math.sqrt(WIDTH // HEADS), dim=-1)
        mixed = (weights @ value).transpose(1, 2).reshape(batch, count, WIDTH)
        tokens = tokens + self.outward(mixed)
        out: Tensor = tokens + self.perceptron(self.second(tokens))
        return out


class TsMixerTrunk(nn.Module):
    """Minutes and segments mixed by perceptrons in turn; it gives three rows, flat.

    Attributes:
        features: Width of the output, the whole mixed history.
    """

    def __init__(self, segments: int) -> None:
        super().__init__()
        self.features = HISTORY * segments
        self.over_time = nn.ModuleList(_perceptron(HISTORY, 2 * HISTORY) for _ in range(BLOCKS))
        self.over_space = nn.ModuleList(_perceptron(segments, MIXER_WIDTH) for _ in range(BLOCKS))

    def forward(self, history: Tensor, state: None = None) -> tuple[Tensor, None]:
        """Reads a history (B, s, N); gives (B, s N)."""
        mixed = history - history[:, -1:]  # relative to the last row, as the heads are
        for over_time, over_space in zip(self.over_time, self.over_space, strict=True):
            mixed = mixed + over_time(mixed.transpose(1, 2)).transpose(1, 2)
            mixed = mixed + over_space(mixed + history)
        return mixed.flatten(1), None


def _perceptron(width: int, hidden: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(width, hidden), nn.GELU(), nn.Linear(hidden, width))
