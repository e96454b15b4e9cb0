"""Benchmarks `forecast-easy` and `forecast-hard`: one forecaster on held-out days.

The days are made on first use and kept. A forecaster is a shipped name, a .safetensors or .onnx file, `persistence`,
"module:Class" of a `Forecaster` that needs no training, or `forecaster` with its setting `model`, as at a service.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dohyo.agents.forecasting.agent import NAME, ShippedForecaster
from dohyo.agents.forecasting.base import Forecaster
from dohyo.agents.forecasting.data.reading import read_set
from dohyo.agents.forecasting.data.speed_table import UNITS
from dohyo.agents.forecasting.data.windows import Windows, make_windows
from dohyo.agents.forecasting.files.fitting import load_fitting
from dohyo.agents.forecasting.judge import forecast_all, measures_by_stretch
from dohyo.agents.forecasting.registry import CHECKPOINTS, make_forecaster, shipped
from dohyo.agents.forecasting.simple import Persistence
from dohyo.agents.forecasting.study.latency import measure
from dohyo.evaluation.entry import load_entry
from dohyo.evaluation.freeway.benchmark import ForecastBenchmark, days_folder
from dohyo.evaluation.freeway.day import METRICS
from dohyo.evaluation.freeway.result import AgentFacts, FreewayResult, Units, claim, write_result
from dohyo.evaluation.settings import check_settings
from dohyo.evaluation.sources import source_files
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.freeway.dataset import dataset_facts, make_dataset
from dohyo.sumo_networks.freeway.measure import MINUTE_S
from dohyo.sumo_networks.freeway.road import load_freeway

TIMED, WARM_UPS = 2000, 200
Progress = Callable[[int, int, float], None]
"""Called with: finished days, their number, and the share of the present one."""


def evaluate_forecaster(
    benchmark: ForecastBenchmark,
    name: str,
    settings: Mapping[str, Any],
    out: Path,
    workers: int = 1,
    progress: Progress = lambda _done, _of, _share: None,
) -> FreewayResult:
    """Measures a forecaster beside persistence, and writes the result.

    Args:
        benchmark: Set of days.
        name: Of the forecaster; see the module.
        settings: `exported` for a shipped name: its ONNX model instead; else of the class's constructor.
        out: Folder of the result.
        workers: Processes that make missing days.
        progress: Called while they are made.

    Raises:
        InvalidInputError: There is no such forecaster, it forecasts another road, or the folder holds another result.
        SimulationError: SUMO failed.
    """
    segments = load_freeway(benchmark.network).segments
    forecaster, facts = forecaster_named(name, segments, settings)
    if forecaster.segments != segments:
        raise InvalidInputError(
            f"'{name}' forecasts {forecaster.segments} segments, benchmark '{benchmark.name}' has {segments}"
        )
    claim(out, benchmark, facts)
    windows, names = benchmark_windows(benchmark, workers, progress)
    free_mps = benchmark.free_kmh * UNITS["km/h"]
    simple = Persistence(segments)
    found = dataset_facts(benchmark.order)
    result = FreewayResult(
        benchmark=benchmark,
        agent=facts,
        reference=simple.name,
        metrics=METRICS,
        units=_units(forecaster, windows, free_mps, names),
        reference_units=_units(simple, windows, free_mps, names),
        versions={key: str(found[key]) for key in ("dohyo", "sumo", "network_sha256")},
        timing=_latency(forecaster, windows),
    )
    write_result(out, result)
    return result


@dataclass(frozen=True, slots=True)
class ShippedSettings:
    """Settings of a forecaster that ships with dohyo.

    Attributes:
        exported: Run the ONNX file, as a car would, and not the network in torch.
    """

    exported: bool = False


def benchmark_windows(
    benchmark: ForecastBenchmark, workers: int = 1, progress: Progress = lambda _done, _of, _share: None
) -> tuple[Windows, tuple[str, ...]]:
    """Windows of a benchmark's days, which are made if missing; and the days' names, by number of stretch."""
    folder = days_folder(benchmark)
    make_dataset(benchmark.order, folder, progress, workers)
    days = read_set(folder, benchmark.days)[: benchmark.number]
    return make_windows(days, MINUTE_S), tuple(day.name for day in days)


def forecaster_named(name: str, segments: int, settings: Mapping[str, Any]) -> tuple[Forecaster, AgentFacts]:
    """Forecaster, and its description in a result.

    Raises:
        InvalidInputError: There is no such forecaster, or it cannot be made.
    """
    if ":" in name:
        return _of_class(name, segments, settings)
    if name == NAME:
        check_settings(ShippedForecaster, f"forecaster '{name}'", settings)
        made = ShippedForecaster(**settings)
        content = b"".join(one.read_bytes() for one in made.files)
        return made.forecaster, AgentFacts(name, dict(settings), hashlib.sha256(content).hexdigest())
    check_settings(ShippedSettings, f"forecaster '{name}'", settings)
    exported = ShippedSettings(**settings).exported
    if name == Persistence.name:
        return make_forecaster(name, segments), AgentFacts(name, {}, "")
    forecaster = load_fitting(name, segments, exported)
    file = CHECKPOINTS / f"{name}{'.onnx' if exported else '.safetensors'}" if name in shipped() else Path(name)
    return forecaster, AgentFacts(name, dict(settings), hashlib.sha256(file.read_bytes()).hexdigest())


def _of_class(entry: str, segments: int, settings: Mapping[str, Any]) -> tuple[Forecaster, AgentFacts]:
    maker = partial(load_entry(entry, "forecaster"), segments, MINUTE_S)
    check_settings(maker, f"forecaster '{entry}'", settings)
    try:
        made = maker(**settings)
    except Exception as error:  # a foreign constructor may raise anything
        raise InvalidInputError(f"forecaster '{entry}' cannot be made: {type(error).__name__}: {error}") from error
    if not isinstance(made, Forecaster):
        raise InvalidInputError(
            f"'{entry}': expected a forecaster (dohyo.agents.forecasting.base.Forecaster), got {made!r}"
        )
    source = b"".join(path.read_bytes() for path in source_files(type(made)))
    return made, AgentFacts(entry, dict(settings), hashlib.sha256(source).hexdigest())


def _units(forecaster: Forecaster, windows: Windows, free_mps: float, names: tuple[str, ...]) -> Units:
    """Values of each day."""
    ahead = forecast_all(forecaster.predict, windows)
    return dict(zip(names, measures_by_stretch(ahead, windows, free_mps), strict=True))


def _latency(forecaster: Forecaster, windows: Windows) -> dict[str, float]:
    """Latency of one forecast from one history, one core."""
    history, time_s = windows.history[0].astype(np.float64), float(windows.time_s[0])
    took = measure(lambda: forecaster.predict(history, time_s), TIMED, WARM_UPS)
    return {"latency_core_ms": round(took.core_ms, 4), "latency_wall_ms": round(took.wall_ms, 4)}
