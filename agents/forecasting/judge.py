"""Judgement of one day: the forecasts in the order of time, and their errors.

A forecaster is asked once a minute, with the last eight minutes alone, so that nothing of the future is seen. Local
evaluations, built-in agents, ONNX policies and policy workers are judged by these functions, and get the same numbers;
an ONNX model computes in single precision, so that its forecasts may differ in the last digits, also by processor.
"""

from __future__ import annotations

import hashlib
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from dohyo.agents.forecasting.data.reading import read_day
from dohyo.agents.forecasting.data.speed_table import UNITS
from dohyo.agents.forecasting.data.windows import HORIZON, Windows, make_windows
from dohyo.agents.forecasting.scores import errors_of
from dohyo.evaluation.freeway.benchmark import days_folder
from dohyo.evaluation.freeway.day import DayRecord, DayScenario, check_forecast
from dohyo.evaluation.records.record import AgentInfo
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import AgentError
from dohyo.sumo_networks.freeway.dataset import dataset_facts, make_day
from dohyo.sumo_networks.freeway.measure import MINUTE_S

Forecast = Callable[[Float32Array, float], ArrayLike]
"""From (8, N) speeds without gaps, m/s, and the time of day of the last row, s, to (3, N) speeds, m/s."""
DECIMALS = 6
VERSIONS = ("dohyo", "sumo", "network_sha256")


def day_windows(scenario: DayScenario) -> Windows:
    """Windows of one day in the order of time; the day is made if it is missing.

    Days of the benchmark's own seed are kept; those of other seeds are made for each evaluation, since a service would
    keep days of every seed that a stranger chooses.

    Raises:
        SimulationError: SUMO failed.
    """
    benchmark = scenario.benchmark
    with _folder_of(scenario) as folder:
        order = benchmark.order.model_copy(update={"seed": scenario.seed})
        day = read_day(make_day(order, folder, benchmark.days, scenario.number))
    return make_windows([day], MINUTE_S)


def judge_day(
    scenario: DayScenario, windows: Windows, forecast: Forecast, info: AgentInfo, benchmark: tuple[str, str]
) -> DayRecord:
    """Record of one forecaster on one day; a fault of the forecaster ends the day, and is recorded.

    Args:
        scenario: The day.
        windows: Its windows, see `day_windows`.
        forecast: The forecaster; it may raise AgentError.
        info: Description of the forecaster.
        benchmark: Name and content hash.
    """
    asked, began = 0, time.monotonic()

    def counted(history: Float32Array, time_s: float) -> ArrayLike:
        nonlocal asked
        answer = forecast(history, time_s)
        asked += 1
        return answer

    failure, measures, digest = None, {}, ""
    try:
        ahead = forecast_all(counted, windows)
        (measures,) = measures_by_stretch(ahead, windows, scenario.benchmark.free_kmh * UNITS["km/h"])
        digest = hashlib.sha256(ahead.tobytes()).hexdigest()
    except AgentError as error:
        failure = str(error)
    known = dataset_facts(scenario.benchmark.order)
    return DayRecord(
        scenario=scenario,
        benchmark=benchmark,
        agent=info,
        failure=failure,
        measures=measures,
        forecasts=asked,
        forecasts_sha256=digest,
        versions={key: str(known[key]) for key in VERSIONS},
        wall_s=round(time.monotonic() - began, 3),
    ).sealed()


def forecast_all(forecast: Forecast, windows: Windows) -> Float32Array:
    """Forecasts (B, 3, N) of a forecaster that is asked window after window.

    Raises:
        InvalidActionError: A forecast is no (3, N) array of finite speeds.
    """
    shape = (HORIZON, windows.history.shape[2])
    answers = [
        check_forecast(forecast(history, float(time_s)), shape)
        for history, time_s in zip(windows.history, windows.time_s, strict=True)
    ]
    return np.asarray(answers, dtype=np.float32)


def measures_by_stretch(ahead: Float32Array, windows: Windows, free_mps: float) -> list[dict[str, float]]:
    """Measures of forecasts (B, 3, N) for each stretch, by the keys of `METRICS`.

    Args:
        ahead: Forecasts, m/s.
        windows: Windows that were forecast.
        free_mps: Speed with the normalised value 1.
    """
    got = errors_of(ahead, windows, free_mps)
    kmh, true = got.squared / UNITS["km/h"] ** 2, got.squared_true
    out = []
    for day, normalised in enumerate(got.normalised):
        values = {"mse": float(normalised.mean())}
        for row in range(HORIZON):
            values[f"mse_{row + 1}"] = float(normalised[row])
            values[f"rmse_{row + 1}"] = float(kmh[day, row])
        values["mse_true"] = float(1e3 * true[day].mean() / got.free_mps**2) if true is not None else 0.0
        out.append({key: round(value, DECIMALS) for key, value in values.items()})
    return out


@contextmanager
def _folder_of(scenario: DayScenario) -> Iterator[Path]:
    if scenario.seed == scenario.benchmark.seed:
        yield days_folder(scenario.benchmark)
        return
    with tempfile.TemporaryDirectory(prefix="dohyo-days-") as folder:
        yield Path(folder)
