"""Motion dataset: scenes and their futures, in shards of one episode each.

A shard is a compressed .npz file of the arrays in `SCHEMA`: float32, integers as int32, flags as bool. Everything is
in the ego's frame at the sample's tick: origin at the centre of its box, x forward, y left; m, rad, m/s. Rows of
actors, lanes, path points and stop lines of all samples are concatenated; `*_count` has the number of each sample.
Only arrays whose names end in `future` or `future_valid` hold data from after the sample's tick.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dohyo.agents.planning import scene as scenes
from dohyo.agents.planning.scene import Scene
from dohyo.agents.shards import check_array, find_shards, pack_shard, read_shard
from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray
from dohyo.sumo_networks.errors import InvalidInputError

SCHEMA_VERSION = 1
FUTURE_STEPS, FUTURE_STEP_S = 16, 0.5
TABLES = ("actors", "lanes", "path", "stop_lines")

SCHEMA = MappingProxyType(
    {
        "time": ("samples", (), "float32"),
        "pose": ("samples", (3,), "float32"),
        "ego": ("samples", (6,), "float32"),  # speed, acceleration, yaw rate, steering, length, width
        "ego_history": ("samples", (4, 3), "float32"),  # x, y, heading 1.5, 1.0, 0.5 and 0 s ago
        "ego_history_valid": ("samples", (4,), "bool"),
        "ego_future": ("samples", (16, 3), "float32"),  # x, y, heading in 0.5, 1.0, ..., 8 s
        "ego_future_valid": ("samples", (16,), "bool"),
        "actors_count": ("samples", (), "int32"),
        "actors_key": ("actors", (), "int32"),
        "actors_kind": ("actors", (), "int32"),
        "actors_state": ("actors", (6,), "float32"),  # x, y, heading, speed, length, width
        "actors_history": ("actors", (4, 3), "float32"),
        "actors_history_valid": ("actors", (4,), "bool"),
        "actors_future": ("actors", (16, 3), "float32"),
        "actors_future_valid": ("actors", (16,), "bool"),
        "lanes_count": ("samples", (), "int32"),
        "lanes_points": ("lanes", (20, 2), "float32"),
        "lanes_attributes": ("lanes", (5,), "float32"),  # width, limit, kind, on route, red
        "lanes_following": ("lanes", (5,), "int32"),
        "path_count": ("samples", (), "int32"),
        "path_points": ("path", (7,), "float32"),  # x, y, heading, curvature, limit, width, s
        "path_lateral": ("samples", (), "float32"),
        "stop_lines_count": ("samples", (), "int32"),
        "stop_lines_state": ("stop_lines", (3,), "float32"),  # s, closed, signal
    }
)
"""Every array: its table, the shape of a row, and the dtype."""


@dataclass(frozen=True, slots=True)
class Sample:
    """Scene with its future.

    Attributes:
        scene: The input.
        ego_future: (16, 3) x, y [m], heading [rad] of the ego in 0.5, 1.0, ..., 8 s, in the frame of the scene.
        ego_future_valid: (16,) poses before the end of the episode.
        actors_future: (N, 16, 3) the same of the scene's actors.
        actors_future_valid: (N, 16) poses that were seen.
    """

    scene: Scene
    ego_future: Float32Array
    ego_future_valid: BoolArray
    actors_future: Float32Array
    actors_future_valid: BoolArray


class Shard:
    """The samples of one episode."""

    def __init__(self, arrays: dict[str, NDArray[Any]]) -> None:
        self.arrays = arrays
        self._starts = {
            table: np.concatenate([[0], np.cumsum(arrays[f"{table}_count"], dtype=np.int64)]) for table in TABLES
        }

    def __len__(self) -> int:
        return len(self.arrays["time"])

    def __getitem__(self, index: int) -> Sample:
        if not 0 <= index < len(self):
            raise IndexError(index)
        part = {table: slice(int(starts[index]), int(starts[index + 1])) for table, starts in self._starts.items()}
        rows = {name: self.arrays[name][part.get(table, index)] for name, (table, _, _) in SCHEMA.items()}
        return Sample(
            scene=_scene(rows),
            ego_future=rows["ego_future"],
            ego_future_valid=rows["ego_future_valid"],
            actors_future=rows["actors_future"],
            actors_future_valid=rows["actors_future_valid"],
        )

    def __iter__(self) -> Iterator[Sample]:
        return (self[index] for index in range(len(self)))

    @classmethod
    def of(cls, samples: Sequence[Sample]) -> Shard:
        """Packs samples."""
        rows = [_rows(sample) for sample in samples]
        arrays: dict[str, NDArray[Any]] = {}
        for name, (table, shape, dtype) in SCHEMA.items():
            parts = [np.asarray(row[name], dtype=dtype) for row in rows]
            empty = np.zeros((0, *shape), dtype=dtype)
            arrays[name] = (np.stack(parts) if table == "samples" else np.concatenate(parts)) if parts else empty
        return cls(arrays)

    def to_bytes(self) -> bytes:
        """Bytes of the file; the same samples give the same bytes."""
        return pack_shard(SCHEMA_VERSION, self.arrays)


def load_shard(path: Path) -> Shard:
    """Reads a shard.

    Raises:
        InvalidInputError: The file is missing, damaged, or of another schema.
    """
    arrays = read_shard(path, "motion", SCHEMA_VERSION, set(SCHEMA))
    _check(path, arrays)
    return Shard(arrays)


def shards_of(folder: Path, split: str) -> list[Path]:
    """The shards of one split ("train", "validation", "test"), sorted.

    Raises:
        InvalidInputError: There are none.
    """
    return find_shards(folder, split, "motion")


def _check(path: Path, arrays: dict[str, NDArray[Any]]) -> None:
    """Raises InvalidInputError if arrays do not fit together, or contain NaN or infinity."""
    for table in TABLES:
        if arrays[f"{table}_count"].ndim != 1 or (arrays[f"{table}_count"] < 0).any():
            raise InvalidInputError(f"motion shard '{path}': expected counts in {table}_count")
    sizes = {"samples": len(np.atleast_1d(arrays["time"]))}
    sizes |= {table: int(arrays[f"{table}_count"].sum()) for table in TABLES}
    for name, (table, shape, dtype) in SCHEMA.items():
        check_array(path, "motion", name, arrays[name], (sizes[table], *shape), dtype)


def _rows(sample: Sample) -> dict[str, Any]:
    scene, ego, actors, lanes, path = (
        sample.scene,
        sample.scene.ego,
        sample.scene.actors,
        sample.scene.lanes,
        sample.scene.path,
    )
    stop = scene.stop_lines
    return {
        "time": scene.time,
        "pose": scene.pose,
        "ego": (ego.speed, ego.acceleration, ego.yaw_rate, ego.steering, ego.length, ego.width),
        "ego_history": ego.history,
        "ego_history_valid": ego.history_valid,
        "ego_future": sample.ego_future,
        "ego_future_valid": sample.ego_future_valid,
        "actors_count": len(actors),
        "actors_key": actors.key,
        "actors_kind": actors.kind,
        "actors_state": np.column_stack([actors.position, actors.heading, actors.speed, actors.length, actors.width]),
        "actors_history": actors.history,
        "actors_history_valid": actors.history_valid,
        "actors_future": sample.actors_future,
        "actors_future_valid": sample.actors_future_valid,
        "lanes_count": len(lanes),
        "lanes_points": lanes.points,
        "lanes_attributes": np.column_stack([lanes.width, lanes.limit, lanes.kind, lanes.on_route, lanes.red]),
        "lanes_following": lanes.following,
        "path_count": len(path.s),
        "path_points": np.column_stack([path.position, path.heading, path.curvature, path.limit, path.width, path.s]),
        "path_lateral": path.lateral,
        "stop_lines_count": len(stop.s),
        "stop_lines_state": np.column_stack([stop.s, stop.closed, stop.signal]),
    }


def _scene(rows: dict[str, NDArray[Any]]) -> Scene:
    speed, acceleration, yaw_rate, steering, length, width = (float(value) for value in rows["ego"])
    state, lanes, path, stop = (
        rows["actors_state"].astype(np.float64),
        rows["lanes_attributes"].astype(np.float64),
        rows["path_points"].astype(np.float64),
        rows["stop_lines_state"].astype(np.float64),
    )
    return Scene(
        time=float(rows["time"]),
        pose=_double(rows["pose"]),
        ego=scenes.Ego(
            speed=speed,
            acceleration=acceleration,
            yaw_rate=yaw_rate,
            steering=steering,
            length=length,
            width=width,
            history=_double(rows["ego_history"]),
            history_valid=rows["ego_history_valid"],
        ),
        actors=scenes.TrackedActors(
            kind=rows["actors_kind"].astype(np.int64),
            key=rows["actors_key"].astype(np.int64),
            position=state[:, :2].copy(),
            heading=state[:, 2].copy(),
            speed=state[:, 3].copy(),
            length=state[:, 4].copy(),
            width=state[:, 5].copy(),
            history=_double(rows["actors_history"]),
            history_valid=rows["actors_history_valid"],
        ),
        lanes=scenes.LanePieces(
            points=_double(rows["lanes_points"]),
            width=lanes[:, 0].copy(),
            limit=lanes[:, 1].copy(),
            kind=lanes[:, 2].astype(np.int64),
            on_route=lanes[:, 3].astype(np.int64),
            red=lanes[:, 4] > 0.5,
            following=rows["lanes_following"].astype(np.int64),
        ),
        path=scenes.ReferencePath(
            position=path[:, :2].copy(),
            heading=path[:, 2].copy(),
            curvature=path[:, 3].copy(),
            limit=path[:, 4].copy(),
            width=path[:, 5].copy(),
            s=path[:, 6].copy(),
            lateral=float(rows["path_lateral"]),
        ),
        stop_lines=scenes.StopLinesAhead(
            s=stop[:, 0].copy(), closed=stop[:, 1] > 0.5, signal=stop[:, 2].astype(np.int64)
        ),
    )


def _double(array: NDArray[Any]) -> FloatArray:
    return array.astype(np.float64)
