"""`dohyo forecast`: trains speed forecasters on a table or a folder of days, and evaluates them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from dohyo.service.cli.output import Json, console, number, print_json, print_rows
from dohyo.sumo_networks.errors import InvalidInputError

if TYPE_CHECKING:
    from dohyo.agents.forecasting.base import Forecaster
    from dohyo.agents.forecasting.data.speed_table import SpeedData

Data = Annotated[Path, typer.Option(help="A folder of `dohyo dataset freeway`, or a CSV or Parquet table.")]
Unit = Annotated[str, typer.Option(help="Unit of the table's speeds: m/s, km/h or mph.")]
Step = Annotated[float | None, typer.Option(min=0.001, help="Minutes between two rows, if the table has no times.")]
Missing = Annotated[float, typer.Option(min=0.0, max=0.99, help="Largest share of a column that may be missing.")]
Stands = Annotated[float | None, typer.Option(help="Number that means a missing speed.")]


def fit(
    data: Data,
    model: Annotated[str, typer.Option(help="persistence, historical-mean, linear, sa-lstm-n-step, tsmixer, ...")],
    out: Annotated[Path | None, typer.Option(help="Write it as .safetensors; networks also as .onnx.")] = None,
    unit: Unit = "m/s",
    step: Step = None,
    max_missing: Missing = 0.3,
    missing_value: Stands = None,
    depth: Annotated[int, typer.Option(min=-1, max=4, help="Depth of the Laplacian pyramid loss; -1: none.")] = 3,
    steps: Annotated[int, typer.Option(min=1, help="Most optimiser steps in each phase.")] = 600,
    batch: Annotated[int | None, typer.Option(min=0, help="Windows per step; 0: all. [default: by width]")] = None,
    rate: Annotated[float, typer.Option(min=1e-6, help="First learning rate.")] = 0.01,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    json: Json = False,
) -> None:
    """Trains a forecaster on the earlier part of the data, and prints its errors on the rest."""
    from dohyo.agents.forecasting import registry, training  # torch takes seconds to import
    from dohyo.agents.forecasting.data.windows import make_windows

    if out is not None and out.suffix != ".safetensors":
        raise InvalidInputError(f"expected --out to end in .safetensors, got '{out}'")
    table = _read(data, unit, step, max_missing, missing_value)
    settings = training.TrainSettings(
        depth=None if depth < 0 else depth, steps=steps, batch=batch, rate=rate, seed=seed
    )
    forecaster = registry.make_forecaster(model, len(table.segments), table.step_s, settings)
    train, validation = (make_windows(table.stretches(name), table.step_s) for name in ("train", "validation"))
    columns = (TextColumn("step"), BarColumn(), MofNCompleteColumn(), TextColumn("MSE x 10^3 {task.fields[error]:.3f}"))
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True) as progress:
        bar = progress.add_task(model, total=None, error=float("nan"))
        forecaster.fit(
            train, validation, lambda done, total, error: progress.update(bar, completed=done, total=total, error=error)
        )
    written = _write(forecaster, out) if out else []
    _report(forecaster, table, table.measured_sets, json, written)


def evaluate(
    data: Data,
    model: Annotated[str, typer.Option(help="A shipped model, a .safetensors or .onnx file, or persistence.")],
    unit: Unit = "m/s",
    step: Step = None,
    max_missing: Missing = 0.3,
    missing_value: Stands = None,
    sets: Annotated[str | None, typer.Option(help="Separated by commas, such as test or easy,hard.")] = None,
    json: Json = False,
) -> None:
    """Prints the errors of a trained forecaster beside those of persistence."""
    from dohyo.agents.forecasting import registry
    from dohyo.agents.forecasting.simple import Persistence

    table = _read(data, unit, step, max_missing, missing_value)
    segments = len(table.segments)
    if model == Persistence.name:
        forecaster: Forecaster = registry.make_forecaster(model, segments, table.step_s)
    else:
        forecaster = registry.load_forecaster(model)
    if forecaster.segments != segments:
        raise InvalidInputError(
            f"'{model}' forecasts {forecaster.segments} segments, '{data}' has {segments}; train one on it with "
            "dohyo forecast fit"
        )
    _report(forecaster, table, sets.split(",") if sets else table.measured_sets, json, [])


def _read(path: Path, unit: str, step_min: float | None, max_missing: float, missing_value: float | None) -> SpeedData:
    from dohyo.agents.forecasting.data.reading import Format, read_data

    return read_data(path, Format(unit, None if step_min is None else 60.0 * step_min, max_missing, missing_value))


def _write(forecaster: Forecaster, path: Path) -> list[Path]:
    """Writes a forecaster's files."""
    from dohyo.agents.forecasting.learned import Learned
    from dohyo.agents.forecasting.quantiles import Quantiles

    forecaster.save(path)
    if not isinstance(forecaster, Learned | Quantiles):
        return [path]
    forecaster.export(path.with_suffix(".onnx"))
    return [path, path.with_suffix(".onnx")]


def _report(
    forecaster: Forecaster, table: SpeedData, sets: Sequence[str], as_json: bool, written: Sequence[Path]
) -> None:
    """Errors by set and forecast row, with those of persistence."""
    from dohyo.agents.forecasting.data.windows import make_windows
    from dohyo.agents.forecasting.scores import errors
    from dohyo.agents.forecasting.simple import Persistence

    document: dict[str, Any] = {"segments": len(table.segments), "step_s": table.step_s, "sets": {}}
    rows = []
    for name in sets:
        windows = make_windows(table.stretches(name), table.step_s)
        free_mps = forecaster.free_mps if forecaster.free_mps > 1.0 else float(np.quantile(windows.history, 0.999))
        simple = Persistence(len(table.segments), table.step_s)
        both = {forecaster_name(forecaster): forecaster, simple.name: simple}
        document["sets"][name] = {"windows": len(windows), "free_mps": free_mps}
        for label, one in both.items():
            got = errors(one, windows, free_mps)
            mse = got.normalised.mean(axis=0)
            facts = {
                "mse_x1000": mse.tolist(),
                "rmse_kmh": got.rmse("km/h").tolist(),
                "rmse_mph": got.rmse("mph").tolist(),
            }
            document["sets"][name][label] = facts
            values = (*mse, *got.rmse("km/h"))
            rows.append((name, label, *(number(float(value)) for value in values)))
    document["written"] = [str(path.resolve()) for path in written]
    if as_json:
        print_json(document)
        return
    ahead = [f"t+{(i + 1) * table.step_s / 60:g} min" for i in range(3)]
    print_rows(["set", "", *(f"MSE x 10^3 {at}" for at in ahead), *(f"km/h {at}" for at in ahead)], rows)
    if table.lag_min:
        console.print(f"the feed is up to {table.lag_min:g} min late: now is that long after its last row")
    for path in written:
        console.print(f"written: {path.resolve()}", soft_wrap=True)


def forecaster_name(forecaster: Forecaster) -> str:
    """Name in tables."""
    return getattr(forecaster, "kind", forecaster.name)
