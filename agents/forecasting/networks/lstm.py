"""LSTM and SA-LSTM: recurrent trunks that read a history minute by minute.

An SA-LSTM is an LSTM whose output gate attends over **space**. Its H = N k hidden units belong to the N segments, k to
each; the pre-activations of the output gate, reshaped to N tokens of width k, attend to each other before the sigmoid:

    z_t = W_o [v_t, h_{t-1}] + b_o                     (N, k) after reshaping; b_o distinguishes the segments
    o_t = sigmoid(z_t + softmax(z_t Q K^T z_t^T / sqrt(d)) z_t V)
    h_t = o_t * tanh(c_t),   input, forget and cell gates as usual

Source: thesis A, section 6.4.1 and figure 6.8, which shows the gate, but not its wiring.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor, nn

State = tuple[Tensor, Tensor]
"""h and c, each (B, H)."""

UNITS_PER_SEGMENT = 3
"""21 segments have 63 hidden units, close to the usual 64."""
ATTENTION_WIDTH = 8
MOST_UNITS = 256
"""Upper bound of hidden units: segments of a long road have fewer, but at least one."""


def units_for(segments: int) -> int:
    """Hidden units per segment."""
    return max(1, min(UNITS_PER_SEGMENT, MOST_UNITS // segments))


class SpatialAttention(nn.Module):
    """Self-attention among segments, equivariant to permutations of the tokens.

    Attributes:
        query: (k, d).
        key: (k, d).
        value: (k, k).
    """

    def __init__(self, width: int, attention_width: int = ATTENTION_WIDTH) -> None:
        super().__init__()
        bound = 1.0 / math.sqrt(width)
        self.query = nn.Parameter(torch.empty(width, attention_width).uniform_(-bound, bound))
        self.key = nn.Parameter(torch.empty(width, attention_width).uniform_(-bound, bound))
        self.value = nn.Parameter(torch.empty(width, width).uniform_(-bound, bound))

    def product(self) -> Tensor:
        """(k, k) Q K^T / sqrt(d): queries and keys meet only in their product."""
        return self.query @ self.key.T / math.sqrt(self.query.shape[1])

    def forward(self, tokens: Tensor) -> Tensor:
        """(B, N, k) tokens plus their attention to the others."""
        return attend(tokens, self.product(), self.value)


def attend(tokens: Tensor, product: Tensor, value: Tensor) -> Tensor:
    """Tokens (B, N, k) + softmax(tokens product tokens^T) tokens value; no module, since calling one costs 2 us."""
    shape, flat = tokens.shape, tokens.reshape(-1, tokens.shape[2])
    asked = torch.mm(flat, product).view(shape)
    weights = torch.softmax(torch.bmm(asked, tokens.transpose(1, 2)), dim=-1)
    return torch.addmm(flat, torch.bmm(weights, tokens).view(flat.shape), value).view(shape)


class LstmTrunk(nn.Module):
    """An LSTM over the rows of a history.

    Attributes:
        features: Width of the output, H.
        weight: (N + H + 1, 4 H) from the speeds, h and 1 to the input, forget, cell and output gates.
    """

    def __init__(self, segments: int) -> None:
        super().__init__()
        self.segments, self.units = segments, units_for(segments)
        self.features = segments * self.units
        bound = 1.0 / math.sqrt(self.features)
        self.weight = nn.Parameter(torch.empty(segments + self.features + 1, 4 * self.features).uniform_(-bound, bound))
        with torch.no_grad():
            self.weight[-1, self.features : 2 * self.features] = 1.0  # the forget gate is open at first

    def forward(self, history: Tensor, state: State | None = None) -> tuple[Tensor, State]:
        """Reads a history (B, s, N), from a state or from zeros; gives the last h (B, H), and the state."""
        batch, size = history.shape[0], self.features
        h, c = self.start(history) if state is None else state
        output_gate = self.output_gate()
        by_row = history.transpose(0, 1).reshape(-1, self.segments)
        inward = torch.addmm(self.weight[-1], by_row, self.weight[: self.segments])
        recurrent = self.weight[self.segments : -1]
        for row in torch.split(inward, batch):
            keep, cell, output = torch.split(torch.addmm(row, h, recurrent), [2 * size, size, size], 1)
            enter, forget = keep.sigmoid().chunk(2, 1)
            c = torch.addcmul(forget * c, enter, cell.tanh())
            h = output_gate(output) * c.tanh()
        return h, (h, c)

    def start(self, history: Tensor) -> State:
        """Initial state of zeros."""
        zeros = history.new_zeros(history.shape[0], self.features)
        return zeros, zeros

    def output_gate(self) -> Callable[[Tensor], Tensor]:
        """Output gate (B, H) from its pre-activation (B, H)."""
        return torch.sigmoid


class SaLstmTrunk(LstmTrunk):
    """An LSTM whose output gate attends over the segments; see the module.

    Attributes:
        attention: Among the segments.
    """

    def __init__(self, segments: int) -> None:
        super().__init__(segments)
        self.attention = SpatialAttention(self.units)

    def output_gate(self) -> Callable[[Tensor], Tensor]:
        """See `LstmTrunk.output_gate`; with attention among segments first."""
        product, value = self.attention.product(), self.attention.value  # once for all rows

        def gate(before: Tensor) -> Tensor:
            tokens = before.reshape(-1, self.segments, self.units)
            return attend(tokens, product, value).view(-1, self.features).sigmoid()

        return gate
