"""Study: filters by GNSS rate and error, with and without calibration and low-pass filter.

    python -m dohyo.agents.localization.study.grid --seeds 10 --out agents/localization/results/study.json

A seed draws the errors of IMU and receiver on each of three routes anew; all arms see the same errors. After 20 s
under open sky (10 fixes a second; 5 s of them at rest) the rate of the cell holds to the end, and the scores count. The
first 120 s of a journey are driven.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from dohyo.agents.localization.filters.base import FilterNoise
from dohyo.agents.localization.filters.lowpass import ALPHA
from dohyo.agents.localization.localizer import Fix, Localizer
from dohyo.agents.localization.settings import CarConstraint, OutlierPolicy, Settings
from dohyo.agents.localization.study.synthetic import ROUTES, Journey, Recording, errors_of, journey_named, record
from dohyo.agents.localization.track import EstimatedTrack, follow
from dohyo.evaluation.scores.localization import accuracy, max_drift, p95, rmse
from dohyo.evaluation.statistics import mean_estimate, paired
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import DohyoError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.sensors.gnss import GnssNoise
from dohyo.sumo_networks.sensors.imu import ICM_20600

OPEN_SKY_S, LENGTH_S, STANDING_S = 20.0, 120.0, 5.0
RATES_HZ = (10.0, 1.0, 0.2, 0.05)
SIGMAS_M = (0.1, 0.3, 0.5, 1.0, 2.5)
FILTERS = ("es-ekf", "ekf", "ukf")
ARMS = {"none": (False, 0.0), "calibrated": (True, 0.0), "calibrated + low-pass": (True, ALPHA)}
SLOW = {"ukf": 2}
"""Filters that run last, on the first seeds only: a run costs as much as ten of another filter."""
SAVED_EVERY = 20  # cells
METRICS = ("accuracy", "rmse", "p95", "max_drift", "nees", "nis", "step_us")


@dataclass(frozen=True, slots=True)
class Cell:
    """One combination of the study.

    Attributes:
        arm: A name of `ARMS`.
        filter: A name of `localizer.FILTERS`.
        rate_hz: Of the fixes.
        sigma_m: Of the fixes' error.
        correlated_share: Share of that error's variance that changes slowly.
        vibration: Of the accelerometer, m/s^2.
        outliers: Treatment of fixes that surprise the filter; "none" where the filters themselves are compared.
    """

    arm: str
    filter: str
    rate_hz: float
    sigma_m: float
    correlated_share: float = 0.5
    vibration: float = 0.0
    outliers: OutlierPolicy = "none"


def cells(filters: tuple[str, ...] = FILTERS) -> Iterator[Cell]:
    """All combinations: the grid, dead reckoning, purely white fixes, and vibration."""
    for arm, name, rate, sigma in product(ARMS, [name for name in filters if name not in SLOW], RATES_HZ, SIGMAS_M):
        yield Cell(arm, name, rate, sigma)
    if "es-ekf" in filters:
        for arm, sigma in product(ARMS, SIGMAS_M):
            yield Cell(arm, "imu", 10.0, sigma)
        for arm, rate, sigma in product(("calibrated", "calibrated + low-pass"), RATES_HZ, (0.1, 0.5)):
            yield Cell(arm, "es-ekf", rate, sigma, vibration=0.5)
    for name, rate, sigma in product([name for name in filters if name not in SLOW], RATES_HZ, SIGMAS_M):
        yield Cell("calibrated", name, rate, sigma, correlated_share=0.0)
    for arm, name, rate, sigma in product(ARMS, [name for name in filters if name in SLOW], RATES_HZ, SIGMAS_M):
        yield Cell(arm, name, rate, sigma)


def grid(filters: Sequence[str]) -> Iterator[Cell]:
    """Cells of the benchmark `localization`: every arm, filter, rate and error; the IMU alone once for all rates."""
    for arm, name, rate, sigma in product(ARMS, filters, RATES_HZ, SIGMAS_M):
        yield Cell(arm, name, rate, sigma)
    for arm in ARMS:
        yield Cell(arm, "imu", RATES_HZ[0], SIGMAS_M[0])


@cache
def _journey(route: str) -> Journey:
    return journey_named(route, STANDING_S, LENGTH_S)


def run_cell(cell: Cell, route: str, seed: int) -> dict[str, float]:
    """The scores of one journey; a filter that never ran, or diverged, has an accuracy of 0 and no error.

    Args:
        cell: The combination.
        route: A name of `synthetic.ROUTES`.
        seed: Of all errors.
    """
    journey, imu = _journey(route), replace(ICM_20600, vibration=cell.vibration)
    gnss = GnssNoise(cell.sigma_m, cell.correlated_share, rate_hz=cell.rate_hz)
    recording = record(journey, imu, gnss, errors_of(route, seed), OPEN_SKY_S)
    calibrate, alpha = ARMS[cell.arm]
    settings = Settings(
        filter=cell.filter,
        calibrate=calibrate,
        alpha=alpha,
        gnss_sigma_m=cell.sigma_m,
        noise=FilterNoise.of(imu),
        start="standing",
        outliers=cell.outliers,
        car=CarConstraint(level_rad=None),
    )
    try:
        track = follow(Localizer(settings), journey.time, recording.imu, fixes_of(journey, recording))
        return score(track.within(OPEN_SKY_S, math.inf), journey)
    except DohyoError:
        return dict.fromkeys(METRICS, math.nan) | {"accuracy": 0.0}


def fixes_of(journey: Journey, recording: Recording) -> list[Fix]:
    """The fixes with their times."""
    rows = recording.fix_rows.astype(int)
    return [Fix(float(journey.time[row]), fix) for row, fix in zip(rows, recording.fixes, strict=True)]


def score(track: EstimatedTrack, journey: Journey) -> dict[str, float]:
    """The metrics of one track."""
    true = journey.position[track.row.astype(int)]
    error = track.position - true
    return {
        "accuracy": accuracy(track.position, true),
        "rmse": rmse(track.position, true),
        "p95": p95(track.position, true),
        "max_drift": max_drift(track.position, true),
        "nees": float(np.mean(_nees(error, track.covariance))),
        "nis": float(np.mean(track.nis)) if track.fixes else math.nan,
        "step_us": track.step_us,
    }


def _nees(error: FloatArray, covariance: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ki,kij,kj->k", error, np.linalg.inv(covariance), error))


def study(seeds: range, todo: Sequence[Cell]) -> Iterator[dict[str, Any]]:
    """Runs cells.

    Args:
        seeds: Of the errors; each on all routes.
        todo: Combinations: `cells` or `grid`.

    Yields:
        The results so far, after every cell.
    """
    rows = []
    values: dict[Cell, dict[str, list[float]]] = {}
    for done, cell in enumerate(todo, 1):
        some = seeds[: SLOW.get(cell.filter, len(seeds))]
        runs = [run_cell(cell, route, seed) for seed, route in product(some, ROUTES)]
        values[cell] = {metric: [run[metric] for run in runs] for metric in METRICS}
        rows.append(asdict(cell) | {metric: _estimate(values[cell][metric]) for metric in METRICS})
        yield {
            "seeds": [seeds.start, seeds.stop - 1],
            "routes": list(ROUTES),
            "machine": f"{platform.machine()}, one thread",
            "done": [done, len(todo)],
            "cells": rows,
            "es_ekf_against": _comparisons(values) if done % SAVED_EVERY == 0 or done == len(todo) else [],
        }


def _estimate(values: list[float]) -> dict[str, float | int | None]:
    """Mean and 95 % interval of the runs that have a value."""
    estimate = mean_estimate([value for value in values if math.isfinite(value)])
    rounded = {key: None if value is None else float(f"{value:.4g}") for key, value in asdict(estimate).items()}
    return rounded | {"n": estimate.n}


def _comparisons(values: dict[Cell, dict[str, list[float]]]) -> list[dict[str, Any]]:
    """RMSE of the ES-EKF minus that of another filter, paired by journey."""
    out = []
    for cell, theirs in values.items():
        ours = values.get(replace(cell, filter="es-ekf"))
        if ours is None or cell.filter not in ("ekf", "ukf"):
            continue
        # In order of seed and route; a filter with fewer seeds ran on the first ones.
        both = [(a, b) for a, b in zip(ours["rmse"], theirs["rmse"], strict=False) if math.isfinite(a + b)]
        if both:
            result = paired([a for a, _ in both], [b for _, b in both])
            difference = _estimate([a - b for a, b in both])
            out.append(asdict(cell) | {"difference_m": difference, "verdict": result.verdict})
    return out


def main() -> None:
    """Runs the study and writes its results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--filters", default=",".join(FILTERS))
    parser.add_argument("--out", type=Path, default=Path("agents/localization/results/study.json"))
    arguments = parser.parse_args()
    for result in study(range(arguments.seeds), list(cells(tuple(arguments.filters.split(","))))):
        done, total = result["done"]
        if done % SAVED_EVERY == 0 or done == total:
            write_results(arguments.out, result)
            print(f"{done} of {total} cells: {arguments.out}", flush=True)


def write_results(path: Path, result: dict[str, Any]) -> None:
    """Writes the results, one cell per line."""
    lines = {
        key: value for key, value in result.items() if not isinstance(value, list) or key in ("seeds", "routes", "done")
    }
    text = json.dumps(lines)[:-1]
    for key in ("cells", "es_ekf_against"):
        text += f', "{key}": [\n' + ",\n".join(json.dumps(row) for row in result[key]) + "\n]"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, (text + "}\n").encode())


if __name__ == "__main__":
    main()
