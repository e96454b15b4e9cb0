"""Log: a recorded run of all actors except the egos, which `simulation.replay` plays back.

The hash of its content identifies a log, so that a scenario cannot run against a different log.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import staged
from dohyo.sumo_networks.networks.entries import user_catalog
from dohyo.sumo_networks.world import Actors

SHIPPED = Path(__file__).parents[1] / "logs"
"""Folder of logs that come with dohyo, so that benchmarks do not change when the recording agent changes."""
DECIMALS = {"x": 2, "y": 2, "heading": 3, "speed": 2}
"""Decimals to which logs round, so that last-bit differences between machines do not change a log."""
_DTYPES = {
    "kind": "|u1",
    "length": "<f4",
    "width": "<f4",
    "first": "<i4",
    "key": "<i4",
    "x": "<f4",
    "y": "<f4",
    "heading": "<f4",
    "speed": "<f4",
    "lane": "<i4",
    "indicator": "|i1",
    "signals": "<i4",
}


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """States of N actors in T ticks from tick 0 on; R rows in the order of time, read-only.

    Attributes:
        names: SUMO id by key.
        kind: (N,) uint8, ActorKind.
        length: (N,) float32, m.
        width: (N,) float32, m.
        first: (T + 1,) int32, first row of each tick.
        key: (R,) int32, rising within a tick.
        x: (R,) float32, m, network frame: centre of the box; all motion is rounded, see `DECIMALS`.
        y: (R,) float32, m.
        heading: (R,) float32, rad.
        speed: (R,) float32, m/s.
        lane: (R,) int32, lane under the actor, -1 if none.
        indicator: (R,) int8, turn indicator: 1 left, -1 right, 0 off.
        signals: (C, 3) int32, first states and changes of the lights: tick, row in `RoadNetwork.signals`, LightState.
    """

    names: tuple[str, ...]
    kind: NDArray[np.uint8]
    length: Float32Array
    width: Float32Array
    first: NDArray[np.int32]
    key: NDArray[np.int32]
    x: Float32Array
    y: Float32Array
    heading: Float32Array
    speed: Float32Array
    lane: NDArray[np.int32]
    indicator: NDArray[np.int8]
    signals: NDArray[np.int32]

    @property
    def ticks(self) -> int:
        """Number of ticks, tick 0 included."""
        return len(self.first) - 1

    def sha256(self) -> str:
        """Hex digest of the values: the names, and the little-endian bytes of every array."""
        digest = hashlib.sha256(json.dumps(self.names).encode())
        for column, dtype in _DTYPES.items():
            digest.update(np.ascontiguousarray(getattr(self, column), dtype=dtype).data)
        return digest.hexdigest()

    def actors(self, tick: int) -> Actors:
        """All actors in one tick."""
        rows = slice(int(self.first[tick]), int(self.first[tick + 1]))
        key = self.key[rows].astype(np.int64)
        return Actors(
            key=key,
            kind=self.kind[key].astype(np.int64),
            position=np.column_stack([self.x[rows], self.y[rows]]).astype(np.float64),
            heading=self.heading[rows].astype(np.float64),
            speed=self.speed[rows].astype(np.float64),
            length=self.length[key].astype(np.float64),
            width=self.width[key].astype(np.float64),
            lane=self.lane[rows].astype(np.int64),
            indicator=self.indicator[rows].astype(np.int64),
        )


class LogRecorder:
    """Collects ticks into a Log."""

    def __init__(self) -> None:
        self._keys: dict[str, int] = {}
        self._bodies: list[tuple[int, float, float]] = []
        self._rows: list[tuple[NDArray[Any], ...]] = []
        self._signals: list[tuple[int, int, int]] = []
        self._lights: NDArray[Any] | None = None

    def append(self, names: Sequence[str], actors: Actors, signals: NDArray[Any]) -> None:
        """Adds one tick.

        Args:
            names: SUMO id of each row of `actors`; their keys are not used.
            actors: All actors.
            signals: (K,) LightState.
        """
        for i, name in enumerate(names):
            if name not in self._keys:
                self._keys[name] = len(self._bodies)
                self._bodies.append((int(actors.kind[i]), float(actors.length[i]), float(actors.width[i])))
        keys = np.array([self._keys[name] for name in names], dtype=np.int64)
        order = np.argsort(keys)
        columns = (keys, actors.position[:, 0], actors.position[:, 1], actors.heading, actors.speed)
        tick = len(self._rows)
        self._rows.append(tuple(column[order] for column in (*columns, actors.lane, actors.indicator)))
        changed = range(len(signals)) if self._lights is None else np.flatnonzero(signals != self._lights).tolist()
        self._signals += [(tick, row, int(signals[row])) for row in changed]
        self._lights = signals.copy()

    def finish(self) -> Log:
        """Makes the log of all appended ticks."""
        kind, length, width = zip(*self._bodies, strict=True) if self._bodies else ((), (), ())
        counts = [len(rows[0]) for rows in self._rows]
        columns = [np.concatenate(column) for column in zip(*self._rows, strict=True)]
        key, x, y, heading, speed, lane, indicator = columns
        arrays = {
            "kind": kind,
            "length": length,
            "width": width,
            "first": np.concatenate([[0], np.cumsum(counts)]),
            "key": key,
            "x": x,
            "y": y,
            "heading": heading,
            "speed": speed,
            "lane": lane,
            "indicator": indicator,
            "signals": np.array(self._signals).reshape(-1, 3),
        }
        return _frozen(tuple(self._keys), arrays)


def logs_folder() -> Path:
    """Folder of new logs: $DOHYO_HOME/logs, else in the user's data folder."""
    return user_catalog().with_name("logs")


def log_path(sha256: str) -> Path:
    """Path of a log's file, existing or not: of a log that comes with dohyo, else in the user's folder."""
    shipped = SHIPPED / f"{sha256}.npz"
    return shipped if shipped.exists() else logs_folder() / shipped.name


def write_log(log: Log) -> Path:
    """Writes a log to its file, completely or not at all.

    Raises:
        OSError: The file cannot be written.
    """
    path = log_path(log.sha256())
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays = {column: getattr(log, column) for column in _DTYPES}
    with staged(path) as draft, draft.open("wb") as file:
        np.savez_compressed(file, names=np.array(log.names, dtype=np.str_), **arrays)
    return path


@lru_cache(maxsize=4)
def read_log(sha256: str, folder: Path) -> Log:
    """Reads a log by its hash, and checks the hash.

    Args:
        sha256: Content hash of the log.
        folder: Folder of logs, see `logs_folder`.

    Raises:
        InvalidInputError: The log is missing or damaged.
    """
    shipped = SHIPPED / f"{sha256}.npz"
    path = shipped if shipped.exists() else folder / shipped.name
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {column: file[column] for column in _DTYPES}
            log = _frozen(tuple(str(name) for name in file["names"]), arrays)
    except FileNotFoundError as error:
        raise InvalidInputError(
            f"no log {sha256[:12]} in {folder}; dohyo benchmarks prepare NAME makes the logs of a benchmark"
        ) from error
    except Exception as error:  # numpy and zipfile raise many types of error for a damaged file
        raise InvalidInputError(f"{path}: expected a log, but the file cannot be read: {error}") from error
    if (found := log.sha256()) != sha256:
        raise InvalidInputError(f"{path}: changed since it was written: expected content {sha256}, got {found}")
    return log


def _frozen(names: tuple[str, ...], arrays: dict[str, Any]) -> Log:
    rounded = {column: np.round(np.asarray(arrays[column], np.float64), n) for column, n in DECIMALS.items()}
    whole = arrays | rounded
    typed = {column: np.ascontiguousarray(whole[column], dtype=dtype) for column, dtype in _DTYPES.items()}
    for values in typed.values():
        values.flags.writeable = False
    return Log(names=names, **typed)
