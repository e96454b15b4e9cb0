"""`dohyo forecast`: trains speed forecasters on tables or a folder of days, evaluates them, and forecasts now."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeGuard

import numpy as np
import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from dohyo.evaluation.output_file import check_output
from dohyo.service.cli.following import ForecastFile, Outage, followed, moment
from dohyo.service.cli.output import Json, console, number, print_json, print_rows
from dohyo.sumo_networks.errors import InvalidInputError

if TYPE_CHECKING:
    from dohyo.agents.forecasting.base import Forecaster
    from dohyo.agents.forecasting.data.grid import Grid
    from dohyo.agents.forecasting.data.reading import Format
    from dohyo.agents.forecasting.data.speed_table import SpeedData
    from dohyo.agents.forecasting.data.windows import Windows
    from dohyo.agents.forecasting.learned import Learned
    from dohyo.agents.forecasting.live.now import Forecast
    from dohyo.agents.forecasting.quantiles import Quantiles

Data = Annotated[
    list[Path],
    typer.Option(help="A folder of `dohyo dataset freeway`, or a CSV or Parquet table; several tables are joined."),
]
Unit = Annotated[str, typer.Option(help="Unit of the table's speeds: m/s, km/h or mph.")]
Step = Annotated[float | None, typer.Option(min=0.001, help="Minutes between two rows, if the table has no times.")]
Missing = Annotated[float, typer.Option(min=0.0, max=0.99, help="Largest share of a column that may be missing.")]
Stands = Annotated[float | None, typer.Option(help="Number that means a missing speed.")]
Tolerance = Annotated[
    float, typer.Option(min=0.0, max=0.5, help="Largest distance of a row from the grid of times, in steps.")
]
Resample = Annotated[
    float | None, typer.Option(min=0.001, help="Minutes of new, longer steps with means over the rows within.")
]
Trust = Annotated[
    bool, typer.Option("--trust-unit", help="Accept speeds that are implausible in --unit, and names such as flow.")
]
DayFirst = Annotated[
    bool | None,
    typer.Option("--day-first/--month-first", help="Order in dates such as 03/04/2026; default: by all dates."),
]
Learn = Annotated[
    str | None, typer.Option(help="Days of a folder to learn from: train, or its mornings; default: train.")
]
FigureFile = Annotated[
    Path | None, typer.Option(help="Write a figure, *.html; a PNG beside it with chromium and playwright.")
]
KEPT_UNIT = "km/h"
ADDED = {True: "written", False: "already there", None: "not written yet"}
"""What has become of a forecast, by the answer of the file."""


def fit(
    data: Data,
    model: Annotated[str, typer.Option(help="persistence, historical-mean, linear, sa-lstm-n-step, tsmixer, ...")],
    out: Annotated[Path | None, typer.Option(help="Write it as .safetensors; networks also as .onnx.")] = None,
    unit: Unit = "m/s",
    step: Step = None,
    max_missing: Missing = 0.3,
    missing_value: Stands = None,
    tolerance: Tolerance = 0.5,
    resample: Resample = None,
    trust_unit: Trust = False,
    day_first: DayFirst = None,
    learn: Learn = None,
    figure: FigureFile = None,
    depth: Annotated[int, typer.Option(min=-1, max=4, help="Depth of the Laplacian pyramid loss; -1: none.")] = 3,
    steps: Annotated[int, typer.Option(min=1, help="Most optimiser steps in each phase.")] = 600,
    batch: Annotated[int | None, typer.Option(min=0, help="Windows per step; 0: all; default: by width.")] = None,
    rate: Annotated[float, typer.Option(min=1e-6, help="First learning rate.")] = 0.01,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    json: Json = False,
) -> None:
    """Trains a forecaster on the earlier part of the data, and prints its errors on the rest."""
    from dohyo.agents.forecasting import registry, training  # torch takes seconds to import
    from dohyo.agents.forecasting.data.windows import make_windows

    if out is not None and out.suffix != ".safetensors":
        raise InvalidInputError(f"expected --out to end in .safetensors, got '{out}'")
    how = _format(unit, step, max_missing, missing_value, tolerance, resample, trust_unit, day_first)
    table = _read(data, how, learn)
    settings = training.TrainSettings(
        depth=None if depth < 0 else depth, steps=steps, batch=batch, rate=rate, seed=seed
    )
    forecaster = registry.make_forecaster(model, len(table.segments), table.step_s, settings)
    forecaster.columns = table.segments
    if out is not None:
        _check_beside(forecaster, out)
    train, validation = (make_windows(table.stretches(name), table.step_s) for name in ("train", "validation"))
    columns = (TextColumn("step"), BarColumn(), MofNCompleteColumn(), TextColumn("MSE x 10^3 {task.fields[error]:.3f}"))
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True) as progress:
        bar = progress.add_task(model, total=None, error=float("nan"))
        forecaster.fit(
            train, validation, lambda done, total, error: progress.update(bar, completed=done, total=total, error=error)
        )
    written = _write(forecaster, out) if out else []
    draw = partial(_draw, forecaster, table, table.measured_sets[0], unit, figure)
    _report(forecaster, table, table.measured_sets, json, written, draw)


def evaluate(
    data: Data,
    model: Annotated[str, typer.Option(help="A shipped model, a .safetensors or .onnx file, or persistence.")],
    unit: Unit = "m/s",
    step: Step = None,
    max_missing: Missing = 0.3,
    missing_value: Stands = None,
    tolerance: Tolerance = 0.5,
    resample: Resample = None,
    trust_unit: Trust = False,
    day_first: DayFirst = None,
    learn: Learn = None,
    figure: FigureFile = None,
    sets: Annotated[str | None, typer.Option(help="Separated by commas, such as test or easy,hard.")] = None,
    json: Json = False,
) -> None:
    """Prints the errors of a trained forecaster beside those of persistence."""
    from dohyo.agents.forecasting.files.fitting import in_order

    how = _format(unit, step, max_missing, missing_value, tolerance, resample, trust_unit, day_first)
    table = _read(data, how, learn)
    forecaster = _loaded(model, len(table.segments), table.step_s, table.source)
    table = in_order(table, forecaster, model, table.source)
    chosen = sets.split(",") if sets else table.measured_sets
    _report(forecaster, table, chosen, json, [], partial(_draw, forecaster, table, chosen[0], unit, figure))


def run(
    data: Data,
    model: Annotated[str, typer.Option(help="A shipped model, a .safetensors or .onnx file, or persistence.")],
    unit: Unit = "m/s",
    step: Step = None,
    missing_value: Stands = None,
    tolerance: Tolerance = 0.5,
    resample: Resample = None,
    trust_unit: Trust = False,
    day_first: DayFirst = None,
    out: Annotated[Path | None, typer.Option(help="Append the forecasts to this CSV file.")] = None,
    figure: FigureFile = None,
    follow: Annotated[bool, typer.Option("--follow", help="Forecast again whenever the table has grown.")] = False,
    every: Annotated[float, typer.Option(min=0.05, help="Seconds between two looks at the table.")] = 5.0,
    idle: Annotated[
        float | None, typer.Option(min=0.1, help="End --follow once the table has not grown for so many seconds.")
    ] = None,
    json: Json = False,
) -> None:
    """Forecasts three steps after a table's last row, with intervals that follow the model's past errors."""
    from dohyo.agents.forecasting.data.reading import read_latest
    from dohyo.agents.forecasting.data.windows import HISTORY
    from dohyo.agents.forecasting.figures import now_figure
    from dohyo.agents.forecasting.files.fitting import in_order
    from dohyo.agents.forecasting.live.now import forecast_now

    if out is not None:
        check_output(out)
    how = _format(unit, step, 1.0, missing_value, tolerance, resample, trust_unit, day_first)
    read = partial(read_latest, data, replace(how, growing=follow))

    def load(grid: Grid) -> tuple[Grid, Forecaster]:
        few = grid.steps < HISTORY  # whose step is no reason to refuse them: a file may just have been rotated
        forecaster = _loaded(model, len(grid.names), grid.step_s, str(data[0]), few)
        return in_order(grid, forecaster, model, str(data[0])), forecaster

    def once() -> Iterator[tuple[Grid, Forecast]]:
        grid, forecaster = load(read())
        yield grid, forecast_now(forecaster, grid)

    file, drawing = ForecastFile(out, unit) if out else None, Outage()
    looks = followed(read, load, every, idle, file.catch_up if file else lambda: None) if follow else once()
    for grid, forecast in looks:
        added = file.append(forecast) if file else None
        _show(forecast, unit, grid.notes, json)
        written: list[Path] = []
        with drawing.passing(f"'{figure}' is drawn again with the next forecast"):
            written = _write_figure(now_figure(forecast, grid, unit), figure) if figure else []
        if file and not json:
            console.print(f"{ADDED[added]}: {file.path.resolve()}")
        if not json:
            _print_written(written)
    if file:
        file.finish()


def _format(
    unit: str,
    step_min: float | None,
    max_missing: float,
    missing_value: float | None,
    tolerance: float,
    resample_min: float | None,
    trust_unit: bool,
    day_first: bool | None,
) -> Format:
    from dohyo.agents.forecasting.data.reading import Format

    step_s, resample_s = (None if minutes is None else 60.0 * minutes for minutes in (step_min, resample_min))
    return Format(unit, step_s, max_missing, missing_value, tolerance, resample_s, trust_unit, day_first=day_first)


def _read(paths: Sequence[Path], how: Format, learn: str | None) -> SpeedData:
    """Tables, or a folder with the set of days to learn from."""
    from dohyo.agents.forecasting.data.reading import read_data

    if learn is None:
        return read_data(paths, how)
    if not paths[0].is_dir():
        raise InvalidInputError(f"expected --learn with a folder of days, '{paths[0]}' is none")
    return read_data(paths, how, learn)


def _loaded(model: str, segments: int, step_s: float, source: str, any_step: bool = False) -> Forecaster:
    """Forecaster that fits a table."""
    from dohyo.agents.forecasting import registry
    from dohyo.agents.forecasting.files.fitting import check_fits, load_fitting
    from dohyo.agents.forecasting.simple import Persistence

    if model == Persistence.name:
        return registry.make_forecaster(model, segments, step_s)
    forecaster = load_fitting(model, segments)
    check_fits(forecaster, segments, None if any_step else step_s, model, source)
    return forecaster


def _draw(forecaster: Forecaster, table: SpeedData, name: str, unit: str, path: Path | None) -> list[Path]:
    """Writes the figure of an evaluation."""
    if path is None:
        return []
    from dohyo.agents.forecasting.figures import evaluation_figure

    return _write_figure(evaluation_figure(forecaster, table, name, unit), path)


def _write_figure(drawn: Any, path: Path | None) -> list[Path]:
    if path is None:
        return []
    from dohyo.evaluation.report.pictures import write_page

    return write_page(drawn, path, "Forecast")


def _show(forecast: Forecast, unit: str, notes: Sequence[str], as_json: bool) -> None:
    """Prints one forecast."""
    from dohyo.agents.forecasting.data.speed_table import UNITS

    ahead, low, high, latest = (
        np.asarray(values, np.float64) / UNITS[unit]
        for values in (forecast.ahead, forecast.low, forecast.high, forecast.latest)
    )
    made_at = moment(forecast.made_s, forecast.offset_s)
    times = [moment(at, forecast.offset_s) for at in forecast.times_s.tolist()]
    if as_json:
        speeds = {name: _known(values) for name, values in (("speed", ahead), ("low", low), ("high", high))}
        document = {"made_at": made_at, "times": times, "segments": list(forecast.segments)}
        print_json({**document, "unit": unit, **speeds, "windows": forecast.windows, "notes": list(notes)})
        return
    console.print(f"{made_at}: the next steps, {unit}", highlight=False)
    rows = []
    for column, name in enumerate(forecast.segments):
        cells = [_cell(ahead[row, column], low[row, column], high[row, column]) for row in range(len(ahead))]
        rows.append((name, "-" if np.isnan(latest[column]) else number(float(latest[column])), *cells))
    print_rows(["segment", "now", *(at[11:16] for at in times)], rows)
    if np.isfinite(low).any():
        console.print(
            f"brackets follow the errors of {forecast.windows} past forecasts of this table, and hold 90 % in the long "
            "run; too narrow if the model was trained on these rows"
        )
    for note in notes:
        console.print(note)


def _print_written(paths: Sequence[Path]) -> None:
    for path in paths:
        console.print(f"written: {path.resolve()}")


def _known(values: np.ndarray) -> list[list[float | None]]:
    return [[None if np.isnan(one) else round(float(one), 3) for one in row] for row in values]


def _cell(middle: float, low: float, high: float) -> str:
    return number(middle) if np.isnan(low) else f"{number(middle)} [{number(low)}, {number(high)}]"


def _check_beside(forecaster: Forecaster, path: Path) -> None:
    """Refuses a file beside which an ONNX model of another forecaster would stay, and would take its facts from it."""
    other = path.with_suffix(".onnx")
    if not _exports(forecaster) and other.exists():
        raise InvalidInputError(
            f"'{forecaster_name(forecaster)}' has no ONNX model, and '{other}' is one of another forecaster: remove "
            "it, or choose another --out"
        )


def _write(forecaster: Forecaster, path: Path) -> list[Path]:
    """Writes a forecaster's files."""
    forecaster.save(path)
    if not _exports(forecaster):
        return [path]
    forecaster.export(path.with_suffix(".onnx"))
    return [path, path.with_suffix(".onnx")]


def _exports(forecaster: Forecaster) -> TypeGuard[Learned | Quantiles]:
    """Whether a forecaster has an ONNX model too."""
    from dohyo.agents.forecasting.learned import Learned
    from dohyo.agents.forecasting.quantiles import Quantiles

    return isinstance(forecaster, Learned | Quantiles)


def _report(
    forecaster: Forecaster,
    table: SpeedData,
    sets: Sequence[str],
    as_json: bool,
    written: Sequence[Path],
    draw: Callable[[], list[Path]],
) -> None:
    """Prints errors by set and forecast row, with those of persistence, then draws, since a browser may take long."""
    from dohyo.agents.forecasting.data.windows import make_windows
    from dohyo.agents.forecasting.simple import Persistence

    simple = Persistence(len(table.segments), table.step_s)
    free_mps = _free_mps(forecaster, table)
    found: dict[str, dict[str, Any]] = {}
    for name in sets:
        windows = make_windows(table.stretches(name), table.step_s)
        days = len(np.unique(windows.stretch))
        found[name] = {"windows": len(windows), "stretches": days, "free_mps": free_mps}
        for label, one in {forecaster_name(forecaster): forecaster, simple.name: simple}.items():
            found[name][label] = _measured(one, windows, free_mps)
    if not as_json:
        _print_errors(table, found)
        _print_written([*written, *draw()])
        return
    facts = {"segments": len(table.segments), "step_s": table.step_s, "missing": table.missing}
    paths = [str(path.resolve()) for path in (*written, *draw())]
    print_json({**facts, "notes": list(table.notes), "sets": found, "written": paths})


def _free_mps(forecaster: Forecaster, table: SpeedData) -> float:
    """Speed with the normalised value 1: the forecaster's own, else that of one trained on this table."""
    from dohyo.agents.forecasting.base import FREE_QUANTILE
    from dohyo.agents.forecasting.data.windows import make_windows

    if forecaster.free_mps > 1.0:
        return forecaster.free_mps
    return float(np.quantile(make_windows(table.stretches("train"), table.step_s).history, FREE_QUANTILE))


def _measured(forecaster: Forecaster, windows: Windows, free_mps: float) -> dict[str, Any]:
    """Errors of a forecaster, and how well it foresees frontiers of congestion; each for three rows ahead."""
    from dohyo.agents.forecasting.live.tracking import tracked_coverage
    from dohyo.agents.forecasting.scores import errors_of, frontier_scores, frontiers_ahead

    ahead = forecaster.predict_many(windows.history, windows.time_s)
    got, (inside, width) = errors_of(ahead, windows, free_mps), tracked_coverage(ahead, windows)
    frontiers = frontier_scores(frontiers_ahead(forecaster, windows, free_mps), windows, free_mps)
    return {
        "mse_x1000": _numbers(got.mse_x1000()),
        "rmse_kmh": _numbers(got.rmse("km/h")),
        "rmse_mph": _numbers(got.rmse("mph")),
        "rmse_kmh_interval": _known(got.rmse_interval(KEPT_UNIT)),
        "inside_percent": [_mean(100.0 * column) for column in inside.T],
        "width_kmh": [_mean(3.6 * column) for column in width.T],
        **{name: [_mean(column) for column in table.T] for name, table in frontiers.items()},
    }


def _print_errors(table: SpeedData, found: Mapping[str, Mapping[str, Any]]) -> None:
    rows = [
        (name, label, *(_optional(value) for value in one["mse_x1000"]), *_speeds(one))
        for name, facts in found.items()
        for label, one in facts.items()
        if isinstance(one, dict)
    ]
    ahead = [f"t+{(i + 1) * table.step_s / 60:g} min" for i in range(3)]
    print_rows(["set", "", *(f"MSE x 10^3 {at}" for at in ahead), *(f"km/h {at}" for at in ahead)], rows)
    counts = ", ".join(f"{one['stretches']} in {name}" for name, one in found.items())
    console.print(
        f"means over stretches (mostly days; {counts}), each with the same weight, of the mean over its windows and "
        "segments; 95 % over stretches"
    )
    free_kmh = 3.6 * next(iter(found.values()))["free_mps"]
    console.print(f"the speed 1 of MSE x 10^3 is {free_kmh:.1f} km/h")
    for name, facts in found.items():
        scores = [
            f"{_optional(one['frontier_f1'][-1])} by {label}" for label, one in facts.items() if isinstance(one, dict)
        ]
        console.print(f"where congestion begins or ends in {name}, F1 in % at {ahead[-1]}: {', '.join(scores)}")
        console.print(_intervals(name, facts, ahead), highlight=False)
    if table.missing:
        console.print(f"{100 * table.missing:.1f} % of the speeds are missing; filled in histories, left out of errors")
    for note in table.notes:
        console.print(note)
    if table.lag_min:
        console.print(f"the feed is up to {table.lag_min:g} min late: now is that long after its last row")


def _intervals(name: str, facts: Mapping[str, Any], ahead: Sequence[str]) -> str:
    """How many values lay inside the intervals that `run` would have given, and how wide these were."""
    each = [
        f"{_optional(one['inside_percent'][-1])} % in {_optional(one['width_kmh'][-1])} km/h by {label}"
        for label, one in facts.items()
        if isinstance(one, dict)
    ]
    return f"inside the intervals of `forecast run` in {name} at {ahead[-1]}, of 90 %: {', '.join(each)}"


def _speeds(facts: Mapping[str, Any]) -> list[str]:
    ends = [[np.nan if end is None else end for end in pair] for pair in facts["rmse_kmh_interval"]]
    return ["-" if rmse is None else _cell(rmse, *pair) for rmse, pair in zip(facts["rmse_kmh"], ends, strict=True)]


def _numbers(values: np.ndarray) -> list[float | None]:
    return [None if np.isnan(one) else float(one) for one in values]


def _mean(values: np.ndarray) -> float | None:
    """Of those that are known."""
    there = values[np.isfinite(values)]
    return round(float(there.mean()), 3) if len(there) else None


def _optional(value: float | None) -> str:
    return "-" if value is None else number(value)


def forecaster_name(forecaster: Forecaster) -> str:
    """Name in tables."""
    return getattr(forecaster, "kind", forecaster.name)
