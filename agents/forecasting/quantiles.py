"""Intervals of a forecast, calibrated on validation days.

The n-step SA-LSTM gives the middle. From each layer's last hidden state, the last row and the change of each segment
within the history, a small perceptron gives the distances of the 5 % and 95 % quantiles (pinball loss). Then
conformalised quantile regression (Romano et al. 2019): per segment and row ahead, both are moved by the same amount so
that 90 % of the validation days' values lie between them. This holds for similar days; on other days it has
to be measured.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn
from torch.nn import functional

from dohyo.agents.forecasting.base import Forecaster, Progress, checked
from dohyo.agents.forecasting.data.scale import InMetres, Scale
from dohyo.agents.forecasting.data.windows import HORIZON, Windows
from dohyo.agents.forecasting.learned import BLOCK, in_double, write_onnx
from dohyo.agents.forecasting.networks.looking_ahead import NStep
from dohyo.agents.forecasting.networks.lstm import SaLstmTrunk
from dohyo.agents.forecasting.training import Examples, TrainSettings, train_network
from dohyo.sumo_networks.arrays import Float32Array, FloatArray

COVERAGE = 0.9
HIDDEN, RATE, STEPS, BATCH = 64, 3e-3, 400, 512


class IntervalNetwork(nn.Module):
    """The n-step SA-LSTM with a lower and an upper end.

    Attributes:
        middle: The point forecast.
        spread: Perceptron from features to the distances of both ends, (B, 3, 2 N).
        moved: (3, N) calibration: outward shift of both ends.
    """

    moved: Tensor

    def __init__(self, segments: int) -> None:
        super().__init__()
        self.middle = NStep(SaLstmTrunk, segments)
        known = int(self.middle.layers[0].features) + 2 * segments + HORIZON  # type: ignore[arg-type]
        self.spread = nn.Sequential(nn.Linear(known, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, 2 * segments))
        self.register_buffer("moved", torch.zeros(HORIZON, segments))

    def known(self, history: Tensor) -> tuple[Tensor, Tensor]:
        """Point forecast (B, 3, N), and features of its uncertainty (B, 3, K)."""
        middle, hidden = self.middle.read(history)
        now = torch.cat([history[:, -1], (history[:, 1:] - history[:, :-1]).abs().mean(1)], -1)[:, None].expand(
            -1, HORIZON, -1
        )
        row = torch.eye(HORIZON)[None].expand(len(history), -1, -1)
        return middle, torch.cat([hidden, now, row], -1)

    def ends(self, middle: Tensor, known: Tensor) -> Tensor:
        """(B, 3, 2, N) lower and upper ends before calibration."""
        below, above = functional.softplus(self.spread(known) - 4.0).chunk(2, -1)
        return torch.stack([middle - below, middle + above], 2)

    def forward(self, history: Tensor) -> Tensor:
        """(B, 3, 3, N): row ahead, then lower end, middle, upper end."""
        middle, known = self.known(history)
        lower, upper = self.ends(middle, known).unbind(2)
        lower, upper = torch.minimum(lower - self.moved, middle), torch.maximum(upper + self.moved, middle)
        return torch.stack([lower, middle, upper], 2)


class Quantiles(Forecaster):
    """Forecasts with 90 % intervals.

    Attributes:
        network: See `IntervalNetwork`.
        settings: Of the point forecast's training.
        scale: Standardisation of its input.
    """

    name: ClassVar[str] = "sa-lstm-quantiles"

    def __init__(self, segments: int, step_s: float = 60.0, settings: TrainSettings | None = None) -> None:
        super().__init__(segments, step_s)
        self.settings = settings or TrainSettings()
        torch.manual_seed(self.settings.seed)
        self.scale = Scale()
        self.network = IntervalNetwork(segments).eval()

    def learn(self, train: Windows, validation: Windows, progress: Progress | None) -> None:
        """Trains the point forecast, then its ends, then calibrates."""
        self.scale = Scale.of(train)
        train_network(self.network.middle, train, validation, self.scale, self.free_mps, self.settings, progress)
        self.learn_ends(train, validation)

    def learn_ends(self, train: Windows, validation: Windows) -> None:
        """Trains the ends around a fixed point forecast, and calibrates them."""
        self.network.middle.requires_grad_(False)
        self._train_ends(Examples(train, self.scale, self.free_mps))
        self._calibrate(Examples(validation, self.scale, self.free_mps))

    def _train_ends(self, examples: Examples) -> None:
        middle, known = self._known(examples)
        optimiser = torch.optim.AdamW(self.network.spread.parameters(), lr=RATE)
        generator = torch.Generator().manual_seed(self.settings.seed)
        level = torch.tensor([(1 - COVERAGE) / 2, (1 + COVERAGE) / 2])[:, None]
        for _ in range(STEPS):
            which = torch.randint(len(examples), (BATCH,), generator=generator)
            error = examples.target[which][:, :, None] - self.network.ends(middle[which], known[which])
            pinball = torch.maximum(level * error, (level - 1.0) * error) * examples.mask[which][:, :, None]
            optimiser.zero_grad()
            pinball.mean().backward()  # type: ignore[no-untyped-call]
            optimiser.step()

    @torch.no_grad()
    def _calibrate(self, examples: Examples) -> None:
        """Moves both ends by the 90 % quantile of the distances of values outside of them."""
        middle, known = self._known(examples)
        lower, upper = self.network.ends(middle, known).unbind(2)
        outside = torch.maximum(lower - examples.target, examples.target - upper)
        for row in range(HORIZON):
            for segment in range(self.segments):
                some = outside[examples.mask[:, row, segment] > 0, row, segment]
                self.network.moved[row, segment] = conformal_quantile(some.numpy(), COVERAGE)

    @torch.no_grad()
    def _known(self, examples: Examples) -> tuple[Tensor, Tensor]:
        parts = [self.network.known(some) for some in torch.split(examples.history, BLOCK)]
        return torch.cat([middle for middle, _ in parts]), torch.cat([known for _, known in parts])

    def intervals_many(self, histories: Float32Array) -> Float32Array:
        """(B, 3, 3, N): row ahead; lower end, middle, upper end; m/s."""
        with in_double(self.network):
            parts = torch.split(self.scale.standard(histories).double(), BLOCK)
            return self.scale.metres(torch.cat([self.network(some) for some in parts]))

    def predict_interval(self, history: ArrayLike) -> FloatArray:
        """(3, 3, N) of one history as `predict` takes it: row ahead; lower end, middle, upper end; m/s.

        Raises:
            InvalidInputError: As `predict`.
        """
        out = self.intervals_many(self._rows(history)[None])[0]
        return np.asarray(np.maximum(out, 0.0), dtype=np.float64)

    def predict_many(self, histories: Float32Array, time_s: FloatArray | None = None) -> Float32Array:
        """The middle; see `Forecaster.predict_many`."""
        return self.intervals_many(histories)[:, :, 1]

    def export(self, path: Path) -> None:
        """Writes an ONNX model: `history` (8, N), m/s, without gaps, to `forecast` (3, 3, N) as `predict_interval`.

        Raises:
            InvalidInputError: It cannot be written.
        """
        write_onnx(InMetres(self.network, self.scale), self.segments, path)

    def tensors(self) -> dict[str, np.ndarray]:
        """See `Forecaster.tensors`."""
        return {name: tensor.numpy() for name, tensor in self.network.state_dict().items()}

    def restore(self, tensors: Mapping[str, np.ndarray]) -> None:
        """See `Forecaster.restore`."""
        checked(tensors, {name: tuple(t.shape) for name, t in self.network.state_dict().items()}, self.name)
        self.network.load_state_dict({name: torch.from_numpy(array) for name, array in tensors.items()})

    def facts(self) -> dict[str, str]:
        """See `Forecaster.facts`."""
        return super().facts() | {"settings": json.dumps(asdict(self.settings))} | self.scale.facts()


def conformal_quantile(scores: np.ndarray, coverage: float) -> float:
    """The ceil((n + 1) coverage)-th smallest of n scores; the largest where that is beyond. 0 without any."""
    n = len(scores)
    if n == 0:
        return 0.0
    place = min(math.ceil((n + 1) * coverage), n) - 1
    return float(np.partition(scores, place)[place])
