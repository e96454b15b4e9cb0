"""Motion of all karts of an evaluation, beside its records: one Parquet file."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import polars as pl

from dohyo.evaluation.parking.drive import Drive
from dohyo.evaluation.parking.record import ParkingRecord
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import staged

MOTION = "motion.parquet"
_COLUMNS = ("x_m", "y_m", "heading_rad", "speed_mps")


def write_motion(folder: Path, drives: Sequence[Drive]) -> None:
    """Writes the motion of all drives: a row for each seed, tick and kart.

    Raises:
        InvalidInputError: The file cannot be written.
    """
    tables = []
    for drive in drives:
        ticks, karts, _ = drive.motion.shape
        tick, kart = np.divmod(np.arange(ticks * karts, dtype=np.int32), karts)
        columns = dict(zip(_COLUMNS, drive.motion.reshape(-1, 4).T, strict=True))
        seed = np.full(ticks * karts, drive.record.seed, np.int64)
        tables.append(pl.DataFrame({"seed": seed, "tick": tick, "kart": kart, **columns}))
    try:
        with staged(folder / MOTION) as draft:
            pl.concat(tables).write_parquet(draft)
    except OSError as error:
        raise InvalidInputError(f"cannot write '{folder / MOTION}': {error.strerror}") from error


def read_motion(folder: Path, records: Sequence[ParkingRecord]) -> Mapping[int, Float32Array]:
    """Motion of some records, (T, K, 4) by seed; empty if the folder has no such file.

    Raises:
        InvalidInputError: The file cannot be read, or a motion is not that of its record.
    """
    path = folder / MOTION
    if not path.exists():
        return {}
    try:
        wanted = pl.Series([record.seed for record in records])
        table = pl.scan_parquet(path).filter(pl.col("seed").is_in(wanted.implode())).collect()
        motions = {
            int(key[0]): part.sort("tick", "kart").select(_COLUMNS).to_numpy().astype(np.float32)
            for key, part in table.group_by("seed")
        }
    except (OSError, pl.exceptions.PolarsError) as error:
        raise InvalidInputError(f"'{path}': expected the motion of parking: {error}") from error
    found = {}
    for record in records:
        motion = motions.get(record.seed, np.zeros((0, 4), np.float32))
        if hashlib.sha256(motion.tobytes()).hexdigest() != record.motion_sha256:
            raise InvalidInputError(f"'{path}': the motion of lot {record.seed} is not that of its record")
        found[record.seed] = motion.reshape(-1, len(record.karts), 4)
    return found
