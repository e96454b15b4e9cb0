"""Forecaster: interface of all forecasters, and their files."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from dohyo.agents.forecasting.data.gaps import fill
from dohyo.agents.forecasting.data.speed_table import DAY_S
from dohyo.agents.forecasting.data.windows import HISTORY, HORIZON, Windows
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

FREE_QUANTILE = 0.999
DECIMALS: Final = 4
"""Of a forecast in m/s."""
Progress = Callable[[int, int, float], None]
"""Called with: steps done, all steps, and the last validation's error."""


class Forecaster(ABC):
    """Forecasts the speeds of the next three rows from the last eight.

    Attributes:
        name: Of the kind.
        segments: Number of columns, N.
        step_s: Seconds between two rows.
        free_mps: Speed with the normalised value 1: the 99.9 % quantile of the training speeds.
        columns: Names of the N columns of its table, in the order along the road; none where they are not known.
    """

    name: ClassVar[str]

    def __init__(self, segments: int, step_s: float = 60.0) -> None:
        if segments < 1:
            raise InvalidInputError(f"expected at least one segment, got {segments}")
        self.segments, self.step_s, self.free_mps = segments, step_s, 1.0
        self.columns: tuple[str, ...] = ()

    def fit(self, train: Windows, validation: Windows, progress: Progress | None = None) -> None:
        """Learns; the same windows and seed give the same forecaster.

        Args:
            train: To learn from.
            validation: To decide when to stop.
            progress: See `Progress`.
        """
        self._check_width(train.history)
        self.free_mps = float(np.quantile(train.history, FREE_QUANTILE))
        self.learn(train, validation, progress)

    def predict(self, history: ArrayLike, time_s: float | None = None) -> FloatArray:
        """The next three rows, (3, N), m/s, to 0.1 mm/s, so that processors agree on them.

        Args:
            history: (T, N) the last rows, m/s, NaN where missing (filled by `gaps.fill`); T is at least 8, and only the
                last 8 are read.
            time_s: Time of day of the last row; only the historical mean reads it.

        Raises:
            InvalidInputError: Another shape, an infinite or negative speed, or no measured speed at all.
        """
        rows = self._rows(history)
        when = None if time_s is None else np.array([time_s % DAY_S])
        ahead = np.asarray(self.predict_many(rows[None], when)[0], dtype=np.float64)
        return np.asarray(np.maximum(ahead, 0.0).round(DECIMALS))

    def nowcast(self, history: ArrayLike, lag_min: float, time_s: float | None = None) -> FloatArray:
        """Present speeds, (N,), m/s, if the last row is `lag_min` minutes old.

        Linear between two rows; time_s is that of the last row.

        Raises:
            InvalidInputError: The lag is longer than three rows, or as `predict`.
        """
        rows_late = 60.0 * lag_min / self.step_s
        if not 0.0 <= rows_late <= HORIZON:
            longest = HORIZON * self.step_s / 60.0
            raise InvalidInputError(f"expected a lag of 0 to {longest:g} minutes, got {lag_min:g}")
        last = fill(self._rows(history)[None])[0, -1:]
        ahead = np.concatenate([last, self.predict(history, time_s)]).astype(np.float64)
        before = min(int(rows_late), HORIZON - 1)
        share = rows_late - before
        return np.asarray((1.0 - share) * ahead[before] + share * ahead[before + 1])

    @abstractmethod
    def learn(self, train: Windows, validation: Windows, progress: Progress | None) -> None:
        """Trains; called by `fit` after its checks."""

    @abstractmethod
    def predict_many(self, histories: Float32Array, time_s: FloatArray | None = None) -> Float32Array:
        """(B, 3, N) of histories (B, 8, N) without gaps and their times of day (B,), m/s; may be below 0."""

    @abstractmethod
    def tensors(self) -> dict[str, np.ndarray]:
        """Learned tensors, by name."""

    @abstractmethod
    def restore(self, tensors: Mapping[str, np.ndarray]) -> None:
        """Restores learned tensors.

        Raises:
            InvalidInputError: Tensors are missing, or have another shape.
        """

    def facts(self) -> dict[str, str]:
        """Other facts in a file."""
        known = {
            "forecaster": self.name,
            "segments": str(self.segments),
            "step_s": repr(self.step_s),
            "free_mps": repr(self.free_mps),
        }
        return known | ({"columns": json.dumps(self.columns)} if self.columns else {})

    def save(self, path: Path) -> None:
        """Writes a safetensors file.

        Raises:
            InvalidInputError: It cannot be written.
        """
        tensors = {name: np.ascontiguousarray(array) for name, array in self.tensors().items()}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, save(tensors, self.facts()))
        except OSError as error:
            raise InvalidInputError(f"cannot write '{path}': {error.strerror}") from error

    def _rows(self, history: ArrayLike) -> Float32Array:
        """(8, N) the last rows, checked, gaps filled."""
        rows = np.asarray(history, dtype=np.float32)
        if rows.ndim != 2 or len(rows) < HISTORY or rows.shape[1] != self.segments:
            raise InvalidInputError(
                f"{self.name}: expected a history of at least {HISTORY} rows and {self.segments} segments, got "
                f"{' x '.join(map(str, rows.shape))}"
            )
        rows = rows[-HISTORY:]
        if np.isinf(rows).any() or (rows < 0.0).any():
            raise InvalidInputError(f"{self.name}: expected speeds of 0 or more, NaN where missing, got {rows.min():g}")
        return np.asarray(fill(rows[None])[0])

    def _check_width(self, histories: Float32Array) -> None:
        if histories.shape[2] != self.segments:
            raise InvalidInputError(f"{self.name}: expected {self.segments} segments, got {histories.shape[2]}")


def read_file(path: Path) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """Facts and tensors of a safetensors file.

    Raises:
        InvalidInputError: It is missing, damaged, or of no forecaster.
    """
    try:
        with safe_open(path, "numpy") as file:
            facts = dict(file.metadata() or {})
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - no mapping
    except FileNotFoundError as error:
        raise InvalidInputError(f"no forecaster '{path}'") from error
    except (OSError, SafetensorError) as error:
        raise InvalidInputError(f"forecaster '{path}' is damaged: {error}") from error
    if "forecaster" not in facts:
        raise InvalidInputError(f"'{path}': expected the file of a forecaster with its kind, got none")
    return facts, tensors


def columns_of(facts: Mapping[str, str]) -> tuple[str, ...]:
    """Names of the columns in the facts of a file; none in older files.

    Raises:
        ValueError: They are damaged.
    """
    names = json.loads(facts.get("columns", "[]"))
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ValueError(f"expected names of columns, got {names}")
    return tuple(names)


def checked(tensors: Mapping[str, np.ndarray], shapes: Mapping[str, tuple[int, ...]], name: str) -> None:
    """Refuses tensors of other names or shapes.

    Raises:
        InvalidInputError: See above.
    """
    got = {key: array.shape for key, array in tensors.items()}
    if got != dict(shapes):
        wrong = next(key for key in {**shapes, **got} if got.get(key) != shapes.get(key))
        raise InvalidInputError(f"{name}: expected tensor '{wrong}' {shapes.get(wrong)}, got {got.get(wrong)}")
