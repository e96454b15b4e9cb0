"""Hand-made roads: a cell-transmission model whose days differ, and the files that hold them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl

from dohyo.agents.forecasting.data.speed_table import Stretch
from dohyo.sumo_networks.arrays import FloatArray

FREE_MPS, WAVE_MPS, CELL_M, JAM_PER_M, CAPACITY = 31.0, 5.0, 540.0, 0.6, 2.2
"""Speeds of traffic and of a jam's tail, a cell, vehicles per metre when standing, vehicles per second at most."""


def road_speeds(
    rows: int, segments: int = 21, seed: int = 0, noise_mps: float = 0.4, start_min: int = 300
) -> FloatArray:
    """(rows, N) speeds, m/s, one row a minute: a morning's demand against a bottleneck near the end of the road."""
    rng = np.random.default_rng(seed)
    peak, strength, width = rng.normal(450, 20), rng.normal(2.3, 0.12), rng.uniform(50, 90)
    bottleneck = np.full(segments, CAPACITY)
    bottleneck[int(0.8 * segments)] *= 0.8
    density, out, step = np.full(segments, 0.02), [], 10.0
    wobble = 0.0
    for minute in range(start_min, start_min + rows):
        for _ in range(6):
            wobble = 0.97 * wobble + rng.normal(0, 0.05)
            demand = max(0.2, 0.6 + strength * np.exp(-(((minute - peak) / width) ** 2)) - 0.4 + wobble)
            send = np.minimum(FREE_MPS * density, CAPACITY)
            take = np.minimum(CAPACITY, WAVE_MPS * (JAM_PER_M - density))
            inflow = np.minimum(np.concatenate([[demand], send[:-1]]), np.minimum(take, bottleneck))
            outflow = np.concatenate([inflow[1:], send[-1:]])
            density = np.clip(density + step / CELL_M * (inflow - outflow), 1e-3, JAM_PER_M)
        out.append(np.minimum(FREE_MPS, np.minimum(FREE_MPS * density, outflow) / density))
    speeds = np.array(out) * (1 + 0.01 * rng.normal(size=segments))
    return np.asarray(np.maximum(speeds + rng.normal(0, noise_mps, speeds.shape), 0.3))


def road_stretch(rows: int = 300, segments: int = 21, seed: int = 0, missing: float = 0.0) -> Stretch:
    """A stretch of that road from 5:00 on."""
    speeds = road_speeds(rows, segments, seed).astype(np.float32)
    holes = np.random.default_rng(seed + 1).random(speeds.shape) < missing
    return Stretch(f"day-{seed}", 300 * 60.0, np.where(holes, np.nan, speeds).astype(np.float32), speeds)


def write_folder(folder: Path, days: int = 4, rows: int = 300, segments: int = 21, missing: float = 0.02) -> Path:
    """A dataset of days: train, one easy day and two hard sets."""
    for name, seeds in (("train", range(days)), ("easy", [100]), ("hard", [200, 201])):
        for number, seed in enumerate(seeds, 1):
            one = road_stretch(rows, segments, seed, missing)
            table: dict[str, object] = {"minute": np.arange(300, 300 + rows)}
            table |= {f"segment_{i:02d}": one.speeds[:, i] for i in range(segments)}
            assert one.truth is not None
            table |= {f"truth_{i:02d}": one.truth[:, i] for i in range(segments)}
            (folder / name).mkdir(parents=True, exist_ok=True)
            pl.DataFrame(table).write_parquet(folder / name / f"day-{number:04d}.parquet")
    (folder / "dataset.json").write_text(json.dumps({"units": "m/s", "step_s": 60, "lag_minutes": 3}))
    return folder


def write_csv(path: Path, speeds: FloatArray, per_mps: float = 1.0, time: bool = True) -> Path:
    """A table of speeds in any unit, with a column of minutes."""
    table: dict[str, object] = {"time": np.arange(len(speeds))} if time else {}
    table |= {f"s{i}": speeds[:, i] * per_mps for i in range(speeds.shape[1])}
    pl.DataFrame(table).write_csv(path)
    return path


def jam_that_grows(seed: int, rows: int = 160, segments: int = 12) -> Stretch:
    """A queue before the last segment that grows upstream by a segment every four minutes, and dissolves."""
    rng = np.random.default_rng(seed)
    speeds = np.full((rows, segments), 30.0)
    for start in range(int(rng.integers(0, 12)), rows - 60, 60):
        for minute in range(60):
            length = min(minute // 4, (60 - minute) // 4)
            speeds[start + minute, segments - length :] = 8.0
    return Stretch("x", 0.0, (speeds + rng.normal(0.0, 0.4, speeds.shape)).astype(np.float32))
