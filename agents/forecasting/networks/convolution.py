"""ConvLSTM and SA-ConvLSTM over a road: convolutions along the segments in place of the gates' matrices.

Sources: Shi et al. 2015 (without peepholes) and Lin et al. 2020 (self-attention memory), in one dimension.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

CHANNELS, KERNEL, ATTENTION_WIDTH = 16, 3, 8


class ConvLstmTrunk(nn.Module):
    """A ConvLSTM over the rows of a history.

    Attributes:
        features: Width of the output, channels times segments.
    """

    def __init__(self, segments: int) -> None:
        super().__init__()
        self.features = CHANNELS * segments
        self.gates = nn.Conv1d(1 + CHANNELS, 4 * CHANNELS, KERNEL, padding=KERNEL // 2)
        nn.init.ones_(self.gates.get_parameter("bias")[CHANNELS : 2 * CHANNELS])  # the forget gate is open at first

    def forward(self, history: Tensor, state: None = None) -> tuple[Tensor, None]:
        """Reads a history (B, s, N); gives the last h, flat (B, C N)."""
        h = history.new_zeros(history.shape[0], CHANNELS, history.shape[2])
        c, memory = h, h
        for row in history.unbind(1):
            enter, forget, output, cell = self.gates(torch.cat([row[:, None], h], 1)).chunk(4, 1)
            c = forget.sigmoid() * c + enter.sigmoid() * cell.tanh()
            h, memory = self.remember(output.sigmoid() * c.tanh(), memory)
        return h.flatten(1), None

    def remember(self, h: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        """Hook after each cell; none here."""
        return h, memory


class SaConvLstmTrunk(ConvLstmTrunk):
    """A ConvLSTM whose hidden state attends over space, to itself and to a memory, after each row."""

    def __init__(self, segments: int) -> None:
        super().__init__(segments)
        self.from_state = nn.Conv1d(CHANNELS, 2 * ATTENTION_WIDTH + CHANNELS, 1)
        self.from_memory = nn.Conv1d(CHANNELS, ATTENTION_WIDTH + CHANNELS, 1)
        self.joined = nn.Conv1d(2 * CHANNELS, CHANNELS, 1)
        self.update = nn.Conv1d(2 * CHANNELS, 3 * CHANNELS, KERNEL, padding=KERNEL // 2)

    def remember(self, h: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        """The self-attention memory module: h and the memory (B, C, N), both renewed."""
        query, key, value = self.from_state(h).split((ATTENTION_WIDTH, ATTENTION_WIDTH, CHANNELS), 1)
        memory_key, memory_value = self.from_memory(memory).split((ATTENTION_WIDTH, CHANNELS), 1)
        both = torch.cat([_attend(query, key, value), _attend(query, memory_key, memory_value)], 1)
        enter, output, content = self.update(torch.cat([self.joined(both), h], 1)).chunk(3, 1)
        gate = enter.sigmoid()
        memory = (1.0 - gate) * memory + gate * content.tanh()
        return output.sigmoid() * memory, memory


def _attend(query: Tensor, key: Tensor, value: Tensor) -> Tensor:
    """(B, C, N) attention of each segment to all; query and key are (B, d, N), value is (B, C, N)."""
    weights = torch.softmax(query.transpose(1, 2) @ key / math.sqrt(query.shape[1]), dim=-1)
    return value @ weights.transpose(1, 2)
