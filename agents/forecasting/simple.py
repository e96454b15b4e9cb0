"""Forecasters without a network: the baselines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from dohyo.agents.forecasting.base import Forecaster, Progress, checked
from dohyo.agents.forecasting.data.speed_table import DAY_S
from dohyo.agents.forecasting.data.windows import HISTORY, HORIZON, Windows
from dohyo.sumo_networks.arrays import Float32Array, FloatArray

BIN_S = 900.0
RIDGES = (1e-3, 1e-2, 1e-1, 1.0, 10.0)
MOST_ROWS = 20_000
"""Largest number of windows of a linear regression; beyond, every n-th is used."""
ROUNDS = 4
"""Of a regression with missing targets: at 30 % of them 0.8 % of their effect is left."""


class Persistence(Forecaster):
    """Persistence: the last row stays."""

    name = "persistence"

    def learn(self, train: Windows, validation: Windows, progress: Progress | None) -> None:
        """Persistence has nothing to learn."""

    def predict_many(self, histories: Float32Array, time_s: FloatArray | None = None) -> Float32Array:
        """See `Forecaster.predict_many`."""
        return np.repeat(histories[:, -1:], HORIZON, axis=1)

    def tensors(self) -> dict[str, np.ndarray]:
        """One tensor, since a file needs one."""
        return {"nothing": np.zeros(1, dtype=np.float32)}

    def restore(self, tensors: Mapping[str, np.ndarray]) -> None:
        """See `Forecaster.restore`."""
        checked(tensors, {"nothing": (1,)}, self.name)


class HistoricalMean(Forecaster):
    """The mean of each segment in each quarter of an hour of the day; of the whole day without a time.

    Attributes:
        by_time: (96, N), m/s; quarters without a measurement have the mean of the day.
        always: (N,) mean of the day.
    """

    name: ClassVar[str] = "historical-mean"
    BINS = int(DAY_S / BIN_S)

    def __init__(self, segments: int, step_s: float = 60.0) -> None:
        super().__init__(segments, step_s)
        self.by_time = np.zeros((self.BINS, segments), dtype=np.float32)
        self.always = np.zeros(segments, dtype=np.float32)

    def learn(self, train: Windows, validation: Windows, progress: Progress | None) -> None:
        """Computes the means."""
        target = train.target[:, 0].astype(np.float64)
        known = np.isfinite(target)
        sums, counts = np.zeros((2, self.BINS, self.segments))
        quarter = self._bin(train.time_s + self.step_s)
        np.add.at(sums, quarter, np.where(known, target, 0.0))
        np.add.at(counts, quarter, known)
        self.always = (sums.sum(0) / np.maximum(counts.sum(0), 1.0)).astype(np.float32)
        self.by_time = np.where(counts > 0, sums / np.maximum(counts, 1.0), self.always).astype(np.float32)

    def predict_many(self, histories: Float32Array, time_s: FloatArray | None = None) -> Float32Array:
        """See `Forecaster.predict_many`."""
        if time_s is None:
            return np.broadcast_to(self.always, (len(histories), HORIZON, self.segments)).copy()
        ahead = np.asarray(time_s)[:, None] + self.step_s * np.arange(1, HORIZON + 1)
        return np.asarray(self.by_time[self._bin(ahead)])

    def tensors(self) -> dict[str, np.ndarray]:
        """See `Forecaster.tensors`."""
        return {"by_time": self.by_time, "always": self.always}

    def restore(self, tensors: Mapping[str, np.ndarray]) -> None:
        """See `Forecaster.restore`."""
        checked(tensors, {"by_time": (self.BINS, self.segments), "always": (self.segments,)}, self.name)
        self.by_time, self.always = tensors["by_time"], tensors["always"]

    def _bin(self, time_s: FloatArray) -> np.typing.NDArray[np.intp]:
        return (time_s % DAY_S // BIN_S).astype(np.intp)


class Linear(Forecaster):
    """Ridge regression of the next rows on the history, both relative to the last row: a vector autoregression.

    Attributes:
        weights: (8 N + 1, 3 N) from the history and a 1.
    """

    name: ClassVar[str] = "linear"

    def __init__(self, segments: int, step_s: float = 60.0) -> None:
        super().__init__(segments, step_s)
        self.weights = np.zeros((HISTORY * segments + 1, HORIZON * segments), dtype=np.float32)

    def learn(self, train: Windows, validation: Windows, progress: Progress | None) -> None:
        """Solves for each strength of the ridge, and keeps the best on the validation windows."""
        every = max(1, len(train) // MOST_ROWS)
        inputs, change = self._inputs(train.history[::every]), self._changes(train, every)
        gram, best = inputs.T @ inputs / len(inputs), np.inf
        history, truth = self._inputs(validation.history), self._changes(validation, 1)
        known = np.isfinite(truth)
        for ridge in RIDGES:
            penalty = ridge * np.diag(gram).mean() * np.eye(len(gram)) * 1e-2
            weights = _solved(gram + penalty, inputs, change)
            error = float(np.mean(np.square(history @ weights - truth), where=known)) if known.any() else 0.0
            if error < best:
                best, self.weights = error, weights.astype(np.float32)

    def predict_many(self, histories: Float32Array, time_s: FloatArray | None = None) -> Float32Array:
        """See `Forecaster.predict_many`."""
        change = (self._inputs(histories) @ self.weights.astype(np.float64)).reshape(-1, HORIZON, self.segments)
        return np.asarray(histories[:, -1:] + self.free_mps * change, dtype=np.float32)

    def tensors(self) -> dict[str, np.ndarray]:
        """See `Forecaster.tensors`."""
        return {"weights": self.weights}

    def restore(self, tensors: Mapping[str, np.ndarray]) -> None:
        """See `Forecaster.restore`."""
        checked(tensors, {"weights": self.weights.shape}, self.name)
        self.weights = tensors["weights"]

    def _inputs(self, histories: Float32Array) -> FloatArray:
        """(B, 8 N + 1) differences of the rows to the last one, the last one, and a 1; normalised."""
        relative = (histories - histories[:, -1:]) / self.free_mps
        relative[:, -1] = histories[:, -1] / self.free_mps
        flat = relative.reshape(len(histories), -1)
        return np.asarray(np.column_stack([flat, np.ones(len(flat))]), dtype=np.float64)

    def _changes(self, windows: Windows, every: int) -> FloatArray:
        """(B, 3 N) targets relative to the last row, normalised, NaN where missing."""
        change = (windows.target[::every] - windows.history[::every, -1:]) / self.free_mps
        return np.asarray(change.reshape(len(change), -1), dtype=np.float64)


def _solved(gram: FloatArray, inputs: FloatArray, targets: FloatArray) -> FloatArray:
    """Weights of the regression on the targets that are known, by expectation-maximisation.

    A missing target is what the weights so far say, at first 0. Each round leaves of the error that this makes at most
    the share of missing targets. Exact weights would ask for a Gram matrix per target.
    """
    known = np.isfinite(targets)
    weights: FloatArray = np.zeros((len(gram), targets.shape[1]))
    for _ in range(1 if known.all() else ROUNDS):
        filled = np.where(known, targets, inputs @ weights)
        weights = np.asarray(np.linalg.solve(gram, inputs.T @ filled / len(inputs)), dtype=np.float64)
    return weights
