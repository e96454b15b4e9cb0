"""Three ways to look three rows ahead: recursive, all at once, n-step.

Every head is one linear layer that gives the change from the last row it has read. It starts from zero, so an untrained
network is persistence. A network has phases of training: the modules that may change, and the rows that count.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from dohyo.agents.forecasting.data.windows import HORIZON

Trunk = Callable[[int], nn.Module]
"""Makes a trunk for a number of segments."""


@dataclass(frozen=True, slots=True)
class Phase:
    """A phase of a training.

    Attributes:
        name: For reports.
        trained: Modules whose parameters may change; all others are frozen.
        rows: Rows ahead that enter the loss, from 0.
    """

    name: str
    trained: Sequence[nn.Module]
    rows: Sequence[int]


class SpeedNetwork(nn.Module, ABC):
    """Reads a history (B, s, N) and gives the next three rows (B, 3, N), all standardised; see `scale.py`."""

    @abstractmethod
    def forward(self, history: Tensor) -> Tensor:
        """(B, 3, N)."""

    @abstractmethod
    def ahead(self, history: Tensor, rows: int) -> Tensor:
        """(B, rows, N) first rows ahead only, without the cost of the others if possible."""

    def phases(self) -> Sequence[Phase]:
        """Successive phases; by default one with all modules."""
        return [Phase("all", [self], range(HORIZON))]


def zero_head(features: int, outputs: int) -> nn.Linear:
    """Linear layer that starts from zero."""
    head = nn.Linear(features, outputs)
    nn.init.zeros_(head.weight)
    nn.init.zeros_(head.bias)
    return head


class Recursive(SpeedNetwork):
    """Trained for one row, fed with its own forecasts for the next ones.

    Attributes:
        trunk: Reads the history.
        head: From its features to N changes.
    """

    def __init__(self, trunk: Trunk, segments: int) -> None:
        super().__init__()
        self.trunk = trunk(segments)
        self.head = zero_head(int(self.trunk.features), segments)  # type: ignore[arg-type]

    def step(self, history: Tensor) -> Tensor:
        """(B, 1, N) the next row."""
        features, _ = self.trunk(history)
        out: Tensor = history[:, -1:] + self.head(features)[:, None]
        return out

    def ahead(self, history: Tensor, rows: int) -> Tensor:
        """See `SpeedNetwork.ahead`."""
        out = []
        for _ in range(rows):
            out.append(self.step(history))
            history = torch.cat([history[:, 1:], out[-1]], 1)
        return torch.cat(out, 1)

    def forward(self, history: Tensor) -> Tensor:
        """See `SpeedNetwork.forward`."""
        return self.ahead(history, HORIZON)

    def phases(self) -> Sequence[Phase]:
        """One phase, for the next row alone."""
        return [Phase("one row", [self], range(1))]


class AllAtOnce(SpeedNetwork):
    """One network, one head for all three rows.

    Attributes:
        trunk: Reads the history.
        head: From its features to 3 N changes.
    """

    def __init__(self, trunk: Trunk, segments: int) -> None:
        super().__init__()
        self.trunk = trunk(segments)
        self.head = zero_head(int(self.trunk.features), HORIZON * segments)  # type: ignore[arg-type]

    def forward(self, history: Tensor) -> Tensor:
        """See `SpeedNetwork.forward`."""
        features, _ = self.trunk(history)
        out: Tensor = history[:, -1:] + self.head(features).view(-1, HORIZON, history.shape[2])
        return out

    def ahead(self, history: Tensor, rows: int) -> Tensor:
        """See `SpeedNetwork.ahead`."""
        return self.forward(history)[:, :rows]


class NStep(SpeedNetwork):
    """A layer for each row: layer i reads the history and the forecasts of the layers before it, s + i - 1 rows.

    It starts from the last (h, c) of the layer before, and all layers share one head. Trained layer by layer,
    all others frozen; the head learns with the first layer; at the end everything is fine-tuned. Source: thesis A,
    section 6.4.2.

    Attributes:
        layers: One trunk per row ahead.
        head: From the features of any of them to N changes.
    """

    def __init__(self, trunk: Trunk, segments: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(trunk(segments) for _ in range(HORIZON))
        self.head = zero_head(int(self.layers[0].features), segments)  # type: ignore[arg-type]

    def ahead(self, history: Tensor, rows: int) -> Tensor:
        """See `SpeedNetwork.ahead`."""
        return self.read(history, rows)[0]

    def forward(self, history: Tensor) -> Tensor:
        """See `SpeedNetwork.forward`."""
        return self.ahead(history, HORIZON)

    def read(self, history: Tensor, rows: int = HORIZON) -> tuple[Tensor, Tensor]:
        """The first rows ahead (B, rows, N), and the last hidden state of each layer (B, rows, H)."""
        state, out, hidden = None, [], []
        for layer in list(self.layers)[:rows]:
            features, state = layer(history, state)
            hidden.append(features)
            out.append(history[:, -1:] + self.head(features)[:, None])
            history = torch.cat([history, out[-1]], 1)
        return torch.cat(out, 1), torch.stack(hidden, 1)

    def phases(self) -> Sequence[Phase]:
        """Layer by layer, then all."""
        first = Phase("layer 1", [self.layers[0], self.head], [0])
        rest = [Phase(f"layer {i + 1}", [self.layers[i]], [i]) for i in range(1, HORIZON)]
        return [first, *rest, Phase("all", [self], range(HORIZON))]
