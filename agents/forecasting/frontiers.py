"""Frontiers: where congestion begins or ends on a road, now and in the next rows, and speeds that follow from it.

    dohyo forecast fit --data speeds.csv --unit km/h --model frontiers --out mine.safetensors

A segment is congested below 60 % of the free speed, and a *frontier* if it is and the one upstream is not, or the
reverse; traffic reaches the first segment freely. A network of self-attention between segments infers one such vector
for each row ahead. Speeds follow by moving the frontiers: the most probable states of all segments under these
probabilities and the present states (Viterbi); a segment whose state changes takes the speed of the nearest one that
is in that state now.

Source: the prediction module of the MegaVanderTest (thesis A, section 6.1), of which the thesis says no more than that
it is based on self-attention and infers these binary vectors. All else is ours.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import ClassVar, Final

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from dohyo.agents.forecasting.base import Forecaster, Progress, checked
from dohyo.agents.forecasting.data.scale import Scale
from dohyo.agents.forecasting.data.windows import HISTORY, HORIZON, Windows
from dohyo.agents.forecasting.learned import BLOCK, in_double
from dohyo.agents.forecasting.networks.attention import WIDTH, AttentionBlock
from dohyo.agents.forecasting.training import TrainSettings
from dohyo.agents.learning.runs.supervised import Cosine, Fit, drawn, fit
from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray, IntArray

CONGESTED_SHARE: Final = 0.6
"""Of the free speed."""
LAYERS, LENGTH, RATE, BATCH, VALIDATE_EVERY = 2, 5, 1e-3, 256, 100
"""Of the network and its training; `LENGTH` is the factor of the settings' steps."""
HOLDS: Final = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Weights of the present states, of which validation chooses: log-odds that a segment stays as it is."""


def congested(speeds: Float32Array, free_mps: float) -> BoolArray:
    """(..., N) whether segments with these speeds are congested; a missing speed is not."""
    return np.asarray(speeds < CONGESTED_SHARE * free_mps)


def frontiers(states: BoolArray) -> BoolArray:
    """(..., N) whether the state of a segment is not that of the one upstream, whose state is free for the first."""
    before = np.concatenate([np.zeros_like(states[..., :1]), states[..., :-1]], axis=-1)
    return np.asarray(states != before)


def known(speeds: Float32Array) -> BoolArray:
    """(..., N) whether it is known if a segment is a frontier: its speed and that of the one upstream are."""
    there = np.isfinite(speeds)
    before = np.concatenate([np.ones_like(there[..., :1]), there[..., :-1]], axis=-1)
    return np.asarray(there & before)


class FrontierNetwork(nn.Module):
    """Standardised histories (B, s, N) and present frontiers (B, N) -> (B, 3, N) log-odds of frontiers.

    Attributes:
        stays: Log-odds by which a present frontier is one in the rows ahead, before anything is learned of the speeds.
    """

    def __init__(self, segments: int) -> None:
        super().__init__()
        self.inward = nn.Linear(HISTORY + 1, WIDTH)
        self.place = nn.Parameter(0.02 * torch.randn(segments, WIDTH))
        self.blocks = nn.ModuleList(AttentionBlock() for _ in range(LAYERS))
        self.norm, self.outward = nn.LayerNorm(WIDTH), nn.Linear(WIDTH, HORIZON)
        self.stays = nn.Parameter(torch.full((1,), 2.0))

    def forward(self, history: Tensor, now: Tensor) -> Tensor:
        """See the class."""
        tokens = self.inward(torch.cat([history, now[:, None]], 1).transpose(1, 2)) + self.place
        for block in self.blocks:
            tokens = block(tokens)
        out: Tensor = self.outward(self.norm(tokens)).transpose(1, 2)
        return out + self.stays * (2.0 * now[:, None] - 1.0)


class Frontiers(Forecaster):
    """See the module.

    Attributes:
        network: The network.
        settings: Of the training.
        scale: Standardisation of its input.
        typical: (2,) mean speed of free and of congested segments, m/s.
        hold: Log-odds that a segment stays as it is.
    """

    name: ClassVar[str] = "frontiers"

    def __init__(self, segments: int, step_s: float = 60.0, settings: TrainSettings | None = None) -> None:
        super().__init__(segments, step_s)
        self.settings = settings or TrainSettings()
        torch.manual_seed(self.settings.seed)  # of the first weights
        self.scale, self.network = Scale(), FrontierNetwork(segments).eval()
        self.typical, self.hold = np.zeros(2), HOLDS[0]

    def learn(self, train: Windows, validation: Windows, progress: Progress | None) -> None:
        """Trains the network by cross-entropy, then chooses how firmly states hold, on the validation windows."""
        self.scale = Scale.of(train)
        slow = congested(train.history, self.free_mps)
        self.typical = np.array([train.history[some].mean() if some.any() else self.free_mps for some in (~slow, slow)])
        examples, held_out = self._examples(train), self._examples(validation)
        steps = LENGTH * self.settings.steps
        job = Fit(
            network=self.network.train(),
            optimizer=torch.optim.AdamW(self.network.parameters(), lr=RATE),
            losses=lambda rows: {"loss": self._loss([part[rows] for part in examples])},
            batches=drawn(len(train), BATCH, self.settings.seed),
            rate=Cosine(RATE, steps),
            steps=steps,
            validate=torch.no_grad()(lambda: {"error": float(self._loss(held_out))}),
            validate_every=VALIDATE_EVERY,
            gradient_norm=self.settings.clip,
            keeps_best=True,
        )
        fit(job, progress=lambda step, row: progress(step, steps, row["loss"]) if progress else None)
        self.network.eval()
        self.hold = min(HOLDS, key=lambda hold: self._error(validation, hold))

    def probabilities(self, histories: Float32Array) -> Float32Array:
        """(B, 3, N) probability that each segment is a frontier in each row ahead, of histories (B, 8, N), m/s."""
        return np.asarray(1.0 / (1.0 + np.exp(-self._log_odds(histories))), np.float32)

    def predict_many(self, histories: Float32Array, time_s: FloatArray | None = None) -> Float32Array:
        """See `Forecaster.predict_many`."""
        return self._speeds(histories, self._log_odds(histories), self.hold)

    def tensors(self) -> dict[str, np.ndarray]:
        """See `Forecaster.tensors`."""
        learned = {name: tensor.numpy() for name, tensor in self.network.state_dict().items()}
        return learned | {"typical": self.typical, "hold": np.array([self.hold])}

    def restore(self, tensors: Mapping[str, np.ndarray]) -> None:
        """See `Forecaster.restore`."""
        checked(tensors, {name: array.shape for name, array in self.tensors().items()}, self.name)
        weights = {name: torch.from_numpy(tensors[name]) for name in self.network.state_dict()}
        self.network.load_state_dict(weights)
        self.typical, self.hold = tensors["typical"], float(tensors["hold"][0])

    def facts(self) -> dict[str, str]:
        """See `Forecaster.facts`."""
        return super().facts() | {"settings": json.dumps(asdict(self.settings))} | self.scale.facts()

    def _now(self, histories: Float32Array) -> Tensor:
        return torch.from_numpy(frontiers(congested(histories[:, -1], self.free_mps))).float()

    def _examples(self, windows: Windows) -> list[Tensor]:
        """Histories, present frontiers, frontiers ahead, and where these are known."""
        ahead = torch.from_numpy(frontiers(congested(windows.target, self.free_mps))).float()
        there = torch.from_numpy(known(windows.target)).float()
        return [self.scale.standard(windows.history), self._now(windows.history), ahead, there]

    def _loss(self, examples: list[Tensor]) -> Tensor:
        history, now, ahead, there = examples
        losses = functional.binary_cross_entropy_with_logits(self.network(history, now), ahead, reduction="none")
        return (losses * there).sum() / there.sum().clamp_min(1.0)

    def _log_odds(self, histories: Float32Array) -> FloatArray:
        with in_double(self.network):
            given = (self.scale.standard(histories), self._now(histories))
            parts = (torch.split(some.double(), BLOCK) for some in given)
            return np.asarray(torch.cat([self.network(*some) for some in zip(*parts, strict=True)]).numpy())

    def _error(self, windows: Windows, hold: float) -> float:
        ahead = self._speeds(windows.history, self._log_odds(windows.history), hold)
        return float(np.nanmean((ahead - windows.target) ** 2))

    def _speeds(self, histories: Float32Array, log_odds: FloatArray, hold: float) -> Float32Array:
        """(B, 3, N) speeds under the most probable states."""
        last = histories[:, -1]
        now = congested(last, self.free_mps)
        nearest = [_nearest(now == state) for state in (False, True)]
        rows = []
        for ahead in range(log_odds.shape[1]):
            states = most_probable(log_odds[:, ahead], now, hold)
            place = np.where(states, nearest[1], nearest[0])
            found = np.where(place < 0, self.typical[states.astype(np.int64)], np.take_along_axis(last, place, 1))
            rows.append(np.where(states == now, last, found))
        return np.asarray(np.stack(rows, axis=1), np.float32)


def most_probable(log_odds: FloatArray, now: BoolArray, hold: float) -> BoolArray:
    """(B, N) states whose frontiers and agreement with the present states are the most probable (Viterbi).

    Args:
        log_odds: (B, N) that each segment is a frontier.
        now: (B, N) whether it is congested now.
        hold: Log-odds that a segment stays as it is.
    """
    rows = np.arange(len(now))
    best = np.tile([0.0, -np.inf], (len(now), 1))  # upstream of the first segment traffic is free
    changed = np.zeros((*now.shape, 2), dtype=bool)
    for segment in range(now.shape[1]):
        other = best[:, ::-1] + log_odds[:, segment, None]
        changed[:, segment] = other > best
        best = np.maximum(best, other)
        best[rows, now[:, segment].astype(np.int64)] += hold
    states, state = np.empty_like(now), best.argmax(axis=1)
    for segment in reversed(range(now.shape[1])):
        states[:, segment] = state == 1
        state = np.where(changed[rows, segment, state], 1 - state, state)
    return states


def _nearest(there: BoolArray) -> IntArray:
    """(B, N) number of the nearest segment of those (B, N), the upstream one of two; -1 without any."""
    numbers = np.arange(there.shape[1])
    distances = np.where(there[:, None, :], np.abs(numbers[:, None] - numbers), there.shape[1])
    return np.where(there.any(axis=1, keepdims=True), distances.argmin(axis=2), -1)
