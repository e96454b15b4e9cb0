"""Motion of all karts and pedestrians of an evaluation, beside its records: one Parquet file."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from dohyo.evaluation.parking.record import ParkingRecord
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import staged

if TYPE_CHECKING:
    from dohyo.evaluation.parking.drive import Drive  # loads numba

MOTION = "motion.parquet"
_COLUMNS = ("x_m", "y_m", "heading_rad", "speed_mps")


def write_motion(folder: Path, drives: Sequence[Drive]) -> None:
    """Writes the motion of all drives to the file of a result folder; see `write_motion_file`.

    Raises:
        InvalidInputError: The file cannot be written.
    """
    write_motion_file(folder / MOTION, drives)


def write_motion_file(path: Path, drives: Sequence[Drive]) -> None:
    """Writes the motion of drives: a row for each seed, tick and mover, which are karts and then pedestrians.

    Raises:
        InvalidInputError: The file cannot be written.
    """
    tables = []
    for drive in drives:
        ticks, movers, _ = drive.motion.shape
        tick, mover = np.divmod(np.arange(ticks * movers, dtype=np.int32), movers)
        columns = dict(zip(_COLUMNS, drive.motion.reshape(-1, 4).T, strict=True))
        seed = np.full(ticks * movers, drive.record.seed, np.int64)
        tables.append(pl.DataFrame({"seed": seed, "tick": tick, "mover": mover, **columns}))
    try:
        with staged(path) as draft:
            pl.concat(tables).write_parquet(draft)
    except OSError as error:
        raise InvalidInputError(f"cannot write '{path}': {error.strerror}") from error


def read_motion(folder: Path, records: Sequence[ParkingRecord]) -> Mapping[int, Float32Array]:
    """Motion of some records, see `Drive`, by seed; empty if the folder has no such file.

    Raises:
        InvalidInputError: The file cannot be read, or a motion is not that of its record.
    """
    return read_motion_file(folder / MOTION, records) if (folder / MOTION).exists() else {}


def read_motion_file(path: Path, records: Sequence[ParkingRecord]) -> Mapping[int, Float32Array]:
    """Motion of some records, see `Drive`, by seed.

    Raises:
        InvalidInputError: The file cannot be read, or a motion is not that of its record.
    """
    try:
        wanted = pl.Series([record.seed for record in records])
        table = pl.scan_parquet(path).filter(pl.col("seed").is_in(wanted.implode())).collect()
        motions = {int(key[0]): _by_tick(part.sort("tick", "mover")) for key, part in table.group_by("seed")}
    except (OSError, ValueError, pl.exceptions.PolarsError) as error:
        raise InvalidInputError(f"'{path}': expected the motion of parking: {error}") from error
    found = {}
    for record in records:
        motion = motions.get(record.seed, np.zeros((0, 1, 4), np.float32))
        if hashlib.sha256(motion.tobytes()).hexdigest() != record.motion_sha256:
            raise InvalidInputError(f"'{path}': the motion of lot {record.seed} is not that of its record")
        found[record.seed] = motion
    return found


def _by_tick(table: pl.DataFrame) -> Float32Array:
    """(T, K + P, 4) motion of one lot."""
    movers = table["mover"].n_unique()
    return table.select(_COLUMNS).to_numpy().astype(np.float32).reshape(-1, movers, len(_COLUMNS))
