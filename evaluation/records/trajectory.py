"""Trajectory: the pose of every ego and actor after every tick, as one long table."""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import BoolArray, Float32Array, IntArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.objects import ObjectStates
from dohyo.sumo_networks.world import ActorKind, World

_DTYPES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "tick": "<i4",
        "key": "<i4",
        "kind": "|u1",
        "x": "<f4",
        "y": "<f4",
        "heading": "<f4",
        "speed": "<f4",
        "length": "<f4",
        "width": "<f4",
        "acceleration": "<f4",
        "steering": "<f4",
        "progress": "<f4",
        "lateral": "<f4",
    }
)
_FIRST_CAPACITY: Final = 4096
ROWS_LIMIT: Final = 50_000_000
SIGNALS_LIMIT_BYTES: Final = 50_000_000
_SIGNALS: Final = "dohyo:signals"


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses of all egos and actors after every tick; R rows in the order of time, read-only.

    Attributes:
        tick: (R,) int32, ticks since the egos started.
        key: (R,) int32, number of the actor; -1 - index for an ego.
        kind: (R,) uint8, ActorKind of the actor.
        x: (R,) float32, m, network frame: centre of the box.
        y: (R,) float32, m.
        heading: (R,) float32, rad, counter-clockwise from +x.
        speed: (R,) float32, m/s.
        length: (R,) float32, m.
        width: (R,) float32, m.
        acceleration: (R,) float32, m/s^2, longitudinal; NaN except for egos, as the next three columns.
        steering: (R,) float32, rad, front wheel angle.
        progress: (R,) float32, m, along the route.
        lateral: (R,) float32, m, signed distance to the route, left positive.
        names: SUMO id, or mission name of an ego, of every key in the table.
        signals: (C, 3) int32, first states and changes of the lights: tick, row in `RoadNetwork.signals`, LightState.
    """

    tick: NDArray[np.int32]
    key: NDArray[np.int32]
    kind: NDArray[np.uint8]
    x: Float32Array
    y: Float32Array
    heading: Float32Array
    speed: Float32Array
    length: Float32Array
    width: Float32Array
    acceleration: Float32Array
    steering: Float32Array
    progress: Float32Array
    lateral: Float32Array
    names: Mapping[int, str]
    signals: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.tick)

    def states(self, rows: IntArray) -> ObjectStates:
        """Some rows as a table of float64, without the tick and without the columns that only egos have."""
        return ObjectStates(
            key=self.key[rows].astype(np.int64),
            kind=self.kind[rows].astype(np.int64),
            position=np.column_stack([self.x[rows], self.y[rows]]).astype(np.float64),
            heading=self.heading[rows].astype(np.float64),
            speed=self.speed[rows].astype(np.float64),
            length=self.length[rows].astype(np.float64),
            width=self.width[rows].astype(np.float64),
        )

    def sha256(self) -> str:
        """Hex digest of the values: little-endian bytes of every column, the names by key, the signals.

        It is not the digest of the Parquet file, whose bytes depend on the version of the writer.
        """
        digest = hashlib.sha256()
        for column, dtype in _DTYPES.items():
            digest.update(np.ascontiguousarray(getattr(self, column), dtype=dtype).data)
        digest.update(json.dumps(sorted(self.names.items())).encode())
        digest.update(np.ascontiguousarray(self.signals, dtype="<i4").data)
        return digest.hexdigest()

    def write_parquet(self, target: Path | IO[bytes]) -> None:
        """Writes the table, with a column `name` beside `key`, dictionary-encoded.

        The signals have another shape and stand in the metadata of the file: JSON, zlib, base64.
        """
        keys = np.array(sorted(self.names), dtype=np.int32)
        names = pl.Series("name", [self.names[int(key)] for key in keys], dtype=pl.String)
        table = pl.DataFrame({column: getattr(self, column) for column in _DTYPES})
        table.insert_column(2, names.gather(np.searchsorted(keys, self.key)))
        signals = zlib.compress(json.dumps(self.signals.tolist(), separators=(",", ":")).encode())
        metadata = {_SIGNALS: base64.b64encode(signals).decode()}
        table.write_parquet(target, compression="zstd", metadata=metadata)

    @classmethod
    def read_parquet(cls, path: Path) -> Trajectory:
        """Reads a file of `write_parquet`; `dohyo.evaluation.records.store.read_trajectory` also detects damage.

        Raises:
            InvalidInputError: If the file is missing, is not Parquet, or holds another table.
        """
        expected = "expected a table of trajectories in Parquet"
        try:
            rows = pl.scan_parquet(path).select(pl.len()).collect().item()
            if rows > ROWS_LIMIT:  # a few bytes of Parquet may stand for any number of rows
                raise InvalidInputError(f"{path}: {expected} of at most {ROWS_LIMIT} rows, got {rows}")
            table = pl.read_parquet(path, memory_map=False)
            signals = pl.read_parquet_metadata(path).get(_SIGNALS, "")
        except (OSError, pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
            raise InvalidInputError(f"{path}: {expected}, but it cannot be read: {_first_line(error)}") from error
        columns = {"name", *_DTYPES}
        if set(table.columns) != columns:
            raise InvalidInputError(f"{path}: {expected} with columns {sorted(columns)}, got {sorted(table.columns)}")
        if any(table.null_count().row(0)):
            raise InvalidInputError(f"{path}: {expected} without nulls")
        arrays: dict[str, NDArray[Any]] = {}
        for column, dtype in _DTYPES.items():
            arrays[column] = table[column].to_numpy()
            if arrays[column].dtype != np.dtype(dtype):
                raise InvalidInputError(
                    f"{path}: {expected} with column '{column}' as {np.dtype(dtype)}, got {arrays[column].dtype}"
                )
        named = table.select("key", "name").unique().sort("key", "name")
        if named["key"].is_duplicated().any():
            raise InvalidInputError(f"{path}: {expected} with one name per key")
        return _frozen(arrays, dict(named.iter_rows()), _parsed_signals(path, signals))


class TrajectoryRecorder:
    """Collects worlds, tick by tick, into a Trajectory.

    Values are copied, so the world's arrays may be reused. The rows of an ego end with the tick in which its episode
    ended.
    """

    def __init__(self) -> None:
        self._columns = {column: _blank(dtype, _FIRST_CAPACITY) for column, dtype in _DTYPES.items()}
        self._rows = 0
        self._active_before: BoolArray | None = None
        self._last: World | None = None
        self._signals: list[tuple[int, int, int]] = []

    def append(self, world: World) -> None:
        """Adds the egos that are active or were active in the tick before, all actors, and the lights that changed."""
        self._append_signals(world)
        egos, actors = world.egos, world.actors
        recorded = egos.active if self._active_before is None else egos.active | self._active_before
        driving = np.flatnonzero(recorded)
        start, middle = self._rows, self._rows + len(driving)
        stop = middle + len(actors)
        if stop > len(self._columns["tick"]):
            self._grow(stop)
        columns = self._columns
        columns["tick"][start:stop] = world.tick
        columns["key"][start:middle] = -1 - driving
        columns["kind"][start:middle] = ActorKind.EGO
        columns["x"][start:middle] = egos.position[driving, 0]
        columns["y"][start:middle] = egos.position[driving, 1]
        for column in ("heading", "speed", "length", "width", "acceleration", "steering", "progress", "lateral"):
            columns[column][start:middle] = getattr(egos, column)[driving]
        columns["x"][middle:stop] = actors.position[:, 0]
        columns["y"][middle:stop] = actors.position[:, 1]
        for column in ("key", "kind", "heading", "speed", "length", "width"):
            columns[column][middle:stop] = getattr(actors, column)
        self._rows = stop
        self._active_before = egos.active.copy()
        self._last = world

    def _append_signals(self, world: World) -> None:
        if self._last is None:
            changed = np.arange(len(world.signals))
        elif world.signals is self._last.signals:  # most ticks: an unchanged array is reused
            return
        else:
            changed = np.flatnonzero(world.signals != self._last.signals)
        self._signals += [(world.tick, row, int(world.signals[row])) for row in changed.tolist()]

    def finish(self) -> Trajectory:
        """The trajectory so far; the recorder may go on."""
        arrays = {column: values[: self._rows].copy() for column, values in self._columns.items()}
        for values in arrays.values():
            if values.dtype.kind == "f":
                values[np.isnan(values)] = np.nan  # arithmetic gives NaNs of either sign, and the digest reads bits
        last = self._last
        keys = np.unique(arrays["key"]).tolist()
        names = {} if last is None else {key: last.name_of(key) for key in keys}
        return _frozen(arrays, names, np.array(self._signals, dtype=np.int32).reshape(-1, 3))

    def _grow(self, rows: int) -> None:
        capacity = max(rows, 2 * len(self._columns["tick"]))
        for column, values in self._columns.items():
            larger = _blank(_DTYPES[column], capacity)
            larger[: self._rows] = values[: self._rows]
            self._columns[column] = larger


def _blank(dtype: str, rows: int) -> NDArray[Any]:
    """New columns; floats start as NaN, the value of columns that actors do not have."""
    return np.full(rows, np.nan if dtype == "<f4" else 0, dtype=dtype)


def _frozen(arrays: dict[str, NDArray[Any]], names: dict[int, str], signals: NDArray[np.int32]) -> Trajectory:
    for values in (*arrays.values(), signals):
        values.flags.writeable = False
    return Trajectory(**arrays, names=MappingProxyType(names), signals=signals)


def _parsed_signals(path: Path, text: str) -> NDArray[np.int32]:
    try:
        unpacking = zlib.decompressobj()
        content = unpacking.decompress(base64.b64decode(text), SIGNALS_LIMIT_BYTES)
        if not unpacking.eof:
            raise ValueError(f"more than {SIGNALS_LIMIT_BYTES} bytes, or truncated")
        return np.array(json.loads(content), dtype=np.int32).reshape(-1, 3)
    except (ValueError, OverflowError, RecursionError, zlib.error) as error:
        raise InvalidInputError(f"{path}: expected the lights' changes in its metadata, got {text[:60]!r}") from error


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0]
