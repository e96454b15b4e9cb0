"""Dataset of the freeway: days of segment speeds in four sets of different days, as Parquet files; resumable.

`train` and `easy` are whole days in meso, weekdays and weekends in turn; `hard` and `mornings` are mornings of dense
congestion in micro, 440 minutes each, to test and to learn from.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import as_completed
from dataclasses import dataclass
from functools import partial
from multiprocessing import active_children
from pathlib import Path
from types import FrameType
from typing import Annotated, Final, Literal

import numpy as np
import polars as pl
from pydantic import Field

from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import staged, write_atomically
from dohyo.sumo_networks.freeway.days import Scale, SpeedDay, drive_day
from dohyo.sumo_networks.freeway.measure import LAG_MINUTES, MINUTE_S, reported_speeds
from dohyo.sumo_networks.freeway.road import load_freeway
from dohyo.sumo_networks.freeway.scenario import DAY_S, Day, FreewayScenario, draw_day
from dohyo.sumo_networks.processes import worker_pool
from dohyo.sumo_networks.simulation.process import sumo_version

Split = Literal["train", "easy", "hard", "mornings"]
SPLITS: tuple[Split, ...] = ("train", "easy", "hard", "mornings")
CONGESTED: tuple[Split, ...] = ("hard", "mornings")
FACTS = "dataset.json"
EASY_SHARE = 60 / 350
HARD_START_S, HARD_MINUTES = 6.0 * 3600, 440
HARD_DEMAND = (1.04, 1.06, 1.08, 1.10)
"""Demand factors of congested mornings in turn; each morning is congested for hours."""
HARD_PEAK_WIDTH = 1.5
INTERRUPTED: Final = 130
"""Exit code of a process that was interrupted while it made a day."""


class DatasetRequest(Config):
    """Request for a dataset: numbers of days and their settings.

    Attributes:
        days: Number of training days; 0 for a dataset with evaluation sets only.
        easy: Number of whole days for evaluation; None: 60 for every 350 training days, at least two.
        hard: Number of congested mornings for evaluation.
        seed: Seed of all random numbers.
        probes: Share of the vehicles whose speed is reported.
        network: Catalog name of a freeway.
        mornings: Number of congested mornings to learn from.
    """

    days: Annotated[int, Field(ge=0, le=9999)]
    easy: Annotated[int, Field(ge=0, le=9999)] | None = None
    hard: Annotated[int, Field(ge=0, le=9999)] = 4
    seed: Annotated[int, Field(ge=0)] = 0
    probes: Annotated[float, Field(gt=0, le=1)] = 0.15
    network: str = "freeway"
    mornings: Annotated[int, Field(ge=0, le=9999)] = 0

    def number(self, split: Split) -> int:
        """Number of days of a set."""
        easy = max(2, round(self.days * EASY_SHARE)) if self.easy is None else self.easy
        return {"train": self.days, "easy": easy, "hard": self.hard, "mornings": self.mornings}[split]


@dataclass(frozen=True, slots=True)
class DayOrder:
    """One file of the dataset.

    Attributes:
        split: Set of the day.
        number: Number within the set, from 1 on.
        scale: Scale of the simulation.
        scenario: Scenario to simulate.
        noise: Seed of the measurement errors.
    """

    split: Split
    number: int
    scale: Scale
    scenario: FreewayScenario
    noise: np.random.SeedSequence

    @property
    def file(self) -> Path:
        """Path of the file within the dataset."""
        return Path(self.split) / f"day-{self.number:04}.parquet"


def day_orders(order: DatasetRequest) -> Iterator[DayOrder]:
    """All days of a request; a day depends only on the seed, its set and its number, not on the number of days."""
    road = load_freeway(order.network)
    for place, split in enumerate(SPLITS):
        for number in range(1, order.number(split) + 1):
            what, drive, noise = np.random.SeedSequence(order.seed, spawn_key=(place, number)).spawn(3)
            day = draw_day((number - 1) % 7, what, road)
            congested = split in CONGESTED
            if congested:
                day = _congested(day, number)
            scenario = FreewayScenario(
                network=order.network,
                seed=int(drive.generate_state(1)[0]),
                day=day,
                start_s=HARD_START_S if congested else 0.0,
                duration_s=HARD_MINUTES * MINUTE_S if congested else DAY_S,
                warm_up_s=900.0 if congested else 0.0,
                probes=order.probes,
            )
            yield DayOrder(split, number, "micro" if congested else "meso", scenario, noise)


def _congested(day: Day, number: int) -> Day:
    demand = HARD_DEMAND[(number - 1) % len(HARD_DEMAND)]
    return day.model_copy(update={"weekday": 1, "demand": demand, "peak_width": HARD_PEAK_WIDTH, "tau_factor": 1.0})


def make_dataset(
    order: DatasetRequest,
    folder: Path,
    progress: Callable[[int, int, float], None] = lambda _done, _of, _share: None,
    workers: int = 1,
) -> int:
    """Makes the missing days; a day is written completely or not at all.

    Args:
        order: Request with the days to make.
        folder: Folder of the dataset.
        progress: Function that receives the days done, all days, and, with one worker, the current day's share.
        workers: Number of processes; it does not change the days.

    Returns:
        Number of days made by this call.

    Raises:
        InvalidInputError: The folder has a dataset of another request, or cannot be written.
        SimulationError: SUMO failed.
    """
    _claim(order, folder)
    days = list(day_orders(order))
    missing = [day for day in days if not (folder / day.file).exists()]
    there = len(days) - len(missing)
    progress(there, len(days), 0.0)
    if workers > 1 and len(missing) > 1:
        _make_in_processes(missing, folder, workers, lambda made: progress(there + made, len(days), 0.0))
        return len(missing)
    for done, day in enumerate(missing, start=there):
        _make(day, folder, partial(progress, done, len(days)))
        progress(done + 1, len(days), 0.0)
    return len(missing)


def _make_in_processes(missing: list[DayOrder], folder: Path, workers: int, tell: Callable[[int], None]) -> None:
    """Makes days in processes, one at a time in each, since SUMO is global; an interruption ends the processes."""
    others = set(active_children())
    pool = worker_pool(min(workers, len(missing)), _make_unless_interrupted)
    try:
        ends = [pool.submit(_make_unless_interrupted, day, folder) for day in missing]
        for made, end in enumerate(as_completed(ends), start=1):
            end.result()
            tell(made)
    except KeyboardInterrupt:
        for process in set(active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _make_unless_interrupted(day: DayOrder, folder: Path) -> None:
    """Makes a day in a process of a pool, which SIGTERM and Ctrl-C end; what it has begun to write is removed."""
    before = {number: signal.signal(number, _interrupt) for number in _ENDS}
    try:
        _make(day, folder)
    except KeyboardInterrupt:
        os._exit(INTERRUPTED)  # the pool would give it the next day
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


_ENDS: Final = (signal.SIGINT, signal.SIGTERM)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    for number in _ENDS:  # Ctrl-C comes to all, then SIGTERM from the pool, and once more when one of them has ended
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def make_day(order: DatasetRequest, folder: Path, split: Split, number: int) -> Path:
    """Makes one day if it is missing.

    Args:
        order: Request that has the day.
        folder: Folder of the dataset.
        split: Set of the day.
        number: Number within the set, from 1.

    Returns:
        Path of the day.

    Raises:
        InvalidInputError: The request has no such day, or as `make_dataset`.
        SimulationError: SUMO failed.
    """
    day = next((one for one in day_orders(order) if (one.split, one.number) == (split, number)), None)
    if day is None:
        raise InvalidInputError(f"expected a day of 1 to {order.number(split)} of the set '{split}', got {number}")
    _claim(order, folder)
    if not (folder / day.file).exists():
        _make(day, folder)
    return folder / day.file


def _make(day: DayOrder, folder: Path, progress: Callable[[float], None] = lambda _share: None) -> None:
    _write(day_table(drive_day(day.scenario, day.scale, progress, drawn=True), day.noise), folder / day.file)


def day_table(day: SpeedDay, noise: np.random.SeedSequence) -> pl.DataFrame:
    """One row per minute: `minute`, reported speeds `segment_00`, ... and true speeds `truth_00`, ..., m/s."""
    reported = reported_speeds(day.probes.speed_mps, day.probes.seconds, np.random.default_rng(noise))
    columns = {"minute": day.minute.astype(np.int32)}
    for name, speeds in (("segment", reported), ("truth", day.truth.speed_mps)):
        columns |= {f"{name}_{place:02}": column.astype(np.float32) for place, column in enumerate(speeds.T)}
    return pl.DataFrame(columns)


def dataset_facts(order: DatasetRequest) -> dict[str, object]:
    """Facts that identify a dataset, without the number of its days."""
    road = load_freeway(order.network)
    return {
        "network": order.network,
        "network_sha256": road.network.sha256,
        "segments": road.segments,
        "lengths_m": [round(float(length), 2) for length in road.lengths_m],
        "units": "m/s",
        "step_s": MINUTE_S,
        "lag_minutes": LAG_MINUTES,
        "probes": order.probes,
        "seed": order.seed,
        "sumo": sumo_version(),
        "dohyo": importlib.metadata.version("dohyo"),
    }


def _claim(order: DatasetRequest, folder: Path) -> None:
    """Writes the dataset's facts, or checks that they are the same; only the number of days may grow."""
    facts, path = dataset_facts(order), folder / FACTS
    try:
        folder.mkdir(parents=True, exist_ok=True)
        before = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        for key, value in facts.items():
            if before and before.get(key) != value:
                raise InvalidInputError(
                    f"'{folder}' has a different dataset: expected {key} {value}, got {before.get(key)}"
                )
        days = {split: max(order.number(split), before.get("days", {}).get(split, 0)) for split in SPLITS}
        write_atomically(path, (json.dumps(facts | {"days": days}, indent=1) + "\n").encode())
    except (OSError, ValueError, AttributeError) as error:
        raise InvalidInputError(f"cannot make a dataset in '{folder}': {error}") from error


def _write(table: pl.DataFrame, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    with staged(target) as draft:
        table.write_parquet(draft, statistics=False)
