"""Log: a recorded run of all actors except the egos, which `simulation.replay` plays back.

The hash of its content identifies a log, so that a scenario cannot run against a different log. Beside the content, the
file states the network on which the log was recorded.
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
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.units import TICK_S
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
        network: Hex sha256 of the network's file, no part of the content hash; None: unknown (older logs).
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
    network: str | None = None

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

    def check(self, network: RoadNetwork, scenario: Scenario) -> None:
        """Checks that a scenario on a network can replay the log.

        Raises:
            InvalidInputError: The log is of another network, or ends before the scenario's duration.
        """
        of_another = self.network not in (None, network.sha256)
        for rows, count in ((self.lane, len(network.lanes.ids)), (self.signals[:, 1], len(network.signals.link))):
            of_another |= bool(len(rows)) and int(rows.max()) >= count
        if of_another:
            raise InvalidInputError(
                f"scenario '{scenario.name}': expected a log of network '{network.name}', got one of another network"
            )
        last_s, duration_s = (self.ticks - 1) * TICK_S, scenario.duration_s or 0.0
        if last_s < duration_s - TICK_S / 2:
            raise InvalidInputError(
                f"scenario '{scenario.name}': expected a log of {duration_s:g} s, got one of {last_s:.1f} s"
            )

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
        self._network: str | None = None

    def append(
        self, names: Sequence[str], actors: Actors, signals: NDArray[Any], network: RoadNetwork | None = None
    ) -> None:
        """Adds one tick.

        Args:
            names: SUMO id of each row of `actors`; their keys are not used.
            actors: All actors.
            signals: (K,) LightState.
            network: Roads of the tick, so that the log is replayed on no others; None: unknown.

        Raises:
            InvalidInputError: The ticks before are of another network.
        """
        roads = network.sha256 if network else None
        if self._rows and roads != self._network:
            raise InvalidInputError("expected all ticks of a log on one network, got one of another network")
        self._network = roads
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
        """Makes the log of all appended ticks.

        Raises:
            InvalidInputError: There is none.
        """
        if not self._rows:
            raise InvalidInputError(
                "expected at least one tick in a log, got none; DrivingEnv.record adds the last one"
            )
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
        return _frozen(tuple(self._keys), arrays, self._network)


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
        names, network = np.array(log.names, dtype=np.str_), np.array(log.network or "", dtype=np.str_)
        np.savez_compressed(file, names=names, network=network, **arrays)
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
            network = str(file["network"]) if "network" in file.files else ""
            log = _frozen(tuple(str(name) for name in file["names"]), arrays, network or None)
    except FileNotFoundError as error:
        raise InvalidInputError(
            f"no log {sha256[:12]} in {folder}; dohyo benchmarks prepare NAME makes the logs of a benchmark"
        ) from error
    except Exception as error:  # numpy and zipfile raise many types of error for a damaged file
        raise InvalidInputError(f"{path}: expected a log, but the file cannot be read: {error}") from error
    if (found := log.sha256()) != sha256:
        raise InvalidInputError(f"{path}: changed since it was written: expected content {sha256}, got {found}")
    return log


def _frozen(names: tuple[str, ...], arrays: dict[str, Any], network: str | None) -> Log:
    rounded = {column: np.round(np.asarray(arrays[column], np.float64), n) for column, n in DECIMALS.items()}
    whole = arrays | rounded
    typed = {column: np.ascontiguousarray(whole[column], dtype=dtype) for column, dtype in _DTYPES.items()}
    for values in typed.values():
        values.flags.writeable = False
    return Log(names=names, **typed, network=network)
