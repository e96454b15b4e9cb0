"""`dohyo localize`: a vehicle's track from real IMU and GNSS logs, and the benchmark of the filters."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import plotly.graph_objects as go
import typer
from rich.progress import MofNCompleteColumn, Progress

from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.localization.diagnosis import SettingsWarning, check_noise, diagnose
from dohyo.agents.localization.filters.consistency import mean_bounds, quantile
from dohyo.agents.localization.late_fix import follow_from_start
from dohyo.agents.localization.logs import (
    ImuLog,
    PositionLog,
    check_together,
    read_imu,
    read_positions,
    read_wheel_speeds,
)
from dohyo.agents.localization.settings import Settings
from dohyo.agents.localization.study.example import write_example
from dohyo.agents.localization.study.figures import error_figure, nis_figure, page, track_figure
from dohyo.agents.localization.study.grid import FILTERS, grid, write_results
from dohyo.agents.localization.study.grid import study as run_study
from dohyo.agents.localization.study.tables import by_sigma
from dohyo.agents.localization.track import EstimatedTrack, smooth
from dohyo.agents.localization.track_file import write_track
from dohyo.evaluation.output_file import write_output
from dohyo.evaluation.report.pictures import write_page
from dohyo.evaluation.scores.localization import accuracy, max_drift, p95, rmse
from dohyo.service.cli.output import Json, console, number, print_json, print_rows
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

FIGURE_PX = 1040


@dataclass(frozen=True)
class Result:
    """What was read and what came of it.

    Attributes:
        settings: Of the localizer.
        imu: Samples.
        gnss: Fixes.
        truth: True positions, if known.
        track: The filter's.
        smoothed: The smoother's, if it ran.
        warnings: What the data say against the settings.
    """

    settings: Settings
    imu: ImuLog
    gnss: PositionLog
    truth: PositionLog | None
    track: EstimatedTrack
    smoothed: EstimatedTrack | None
    warnings: Sequence[SettingsWarning]

    @property
    def best(self) -> EstimatedTrack:
        """The smoothed track, or the filter's without a smoother."""
        return self.track if self.smoothed is None else self.smoothed


def localize(
    imu: Annotated[
        Path | None, typer.Option(help="CSV: t, ax, ay, az, gx, gy, gz (SI; x forward, y left, z up).")
    ] = None,
    gnss: Annotated[
        Path | None, typer.Option(help="CSV: t, lat, lon, alt (degrees, m) or t, x, y, z (m); and sigma (m) if known.")
    ] = None,
    truth: Annotated[Path | None, typer.Option(help="CSV like --gnss, to score the estimate against.")] = None,
    wheel_speed: Annotated[Path | None, typer.Option(help="CSV: t, v (m/s), the car's speed by its wheels.")] = None,
    track: Annotated[Path | None, typer.Option(help="Write the track as CSV: t, x, y, heading, sigma_x, ...")] = None,
    figure: Annotated[
        Path | None, typer.Option(help="Write its figure, *.html; a PNG beside it with chromium and playwright.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Write an HTML report with the track.")] = None,
    config: Annotated[Path | None, typer.Option(help="TOML file of the settings, which the options change.")] = None,
    sets: Annotated[
        list[str] | None,
        typer.Option("--set", help="A setting, such as noise.accelerometer=0.1, start=rolling, car.sideways_mps=0.2."),
    ] = None,
    filter_: Annotated[str, typer.Option("--filter", help="es-ekf, ekf, ukf or imu.")] = "es-ekf",
    sigma: Annotated[
        float | None, typer.Option(min=0.001, help="Standard deviation of a fix without its own, m; default: 2.1.")
    ] = None,
    alpha: Annotated[
        float | None, typer.Option(min=0.0, max=0.99, help="Low-pass coefficient; 0: no filter; default: 0.6.")
    ] = None,
    standing: Annotated[
        float | None, typer.Option(min=0.3, help="Seconds for which the vehicle stands at the start; default: 3.")
    ] = None,
    calibrate: Annotated[bool, typer.Option(help="Measure the IMU's offsets while the vehicle stands.")] = True,
    smoother: Annotated[
        bool, typer.Option("--smooth/--no-smooth", help="Smooth the track of the es-ekf: RTS, which knows all fixes.")
    ] = True,
    strict: Annotated[bool, typer.Option("--strict", help="Exit code 3 if there is a warning.")] = False,
    example: Annotated[Path | None, typer.Option(help="Write the logs of a simulated drive here; no others.")] = None,
    study: Annotated[bool, typer.Option("--study", help="Run the benchmark 'localization' instead; no logs.")] = False,
    seeds: Annotated[int, typer.Option(min=1, help="Number of error seeds of --study, each on three routes.")] = 1,
    json: Json = False,
) -> None:
    """Estimates a vehicle's track from IMU and GNSS logs, whether it stands or drives at first.

    Warnings come where the fixes say that the settings are wrong. With --study it runs the benchmark 'localization' on
    simulated logs: calibration and low-pass filter, GNSS rate and error, one filter.
    """
    if study:
        _study(filter_, seeds, out, json)
        return
    if example:
        for path in write_example(example):
            console.print(f"written: {path}")
        return
    if imu is None or gnss is None:
        raise InvalidInputError("expected --imu and --gnss, --example or --study")
    told = {"gnss_sigma_m": sigma, "alpha": alpha, "standing_s": standing}
    words = [f"{name}={value}" for name, value in told.items() if value is not None]
    words += [f'filter="{filter_}"'] if filter_ != "es-ekf" else []
    words += [] if calibrate else ["calibrate=false"]
    settings = read_settings(Settings, config, [*words, *(sets or [])])
    result = _localized(settings, imu, gnss, truth, wheel_speed, smoother)
    title = f"Localization: {imu.name}"
    if track:
        write_track(track, result.best, result.gnss.origin)
    if out:
        _write_report(out, title, result)
    if not json:
        _print(result)
    written = [path.resolve() for path in (track, out) if path]
    if figure:  # last, since a browser may take long
        drawn = _track_figure(result).update_layout(width=FIGURE_PX)
        written += [path.resolve() for path in write_page(drawn, figure, title)]
    if json:
        print_json(_document(result, written))
    else:
        for path in written:
            console.print(f"written: {path}")
    if strict and result.warnings:
        raise typer.Exit(3)


def _localized(
    settings: Settings, imu: Path, gnss: Path, truth: Path | None, wheel_speed: Path | None, smoother: bool
) -> Result:
    """Reads the logs, and runs filter and smoother."""
    samples, fixes = read_imu(imu), read_positions(gnss)
    true = read_positions(truth, fixes.origin) if truth else None
    if true and (true.origin is None) != (fixes.origin is None):
        raise InvalidInputError(f"'{truth}' and '{gnss}': expected both in degrees or both in metres")
    speeds = read_wheel_speeds(wheel_speed) if wheel_speed else []
    check_together(samples, fixes)
    if fixes.start_sigma_m is not None:
        settings = settings.model_copy(update={"gnss_sigma_m": fixes.start_sigma_m})
    recording = samples.time, samples.samples, fixes.fixes(), speeds
    localizer, track = follow_from_start(settings, *recording)
    return Result(
        settings=settings,
        imu=samples,
        gnss=fixes,
        truth=true,
        track=track,
        smoothed=smooth(localizer, track, *recording) if smoother and settings.filter == "es-ekf" else None,
        warnings=[
            *diagnose(track, settings, fixes.sigma_m is not None),
            *check_noise(samples.time, samples.samples, settings),
        ],
    )


def _measured(result: Result) -> tuple[dict[str, float], dict[str, float]]:
    """Facts of the filter's track, and scores of the smoother's."""
    facts = _facts(result.track, result.truth) | _timing(result.track, result.imu, result.gnss)
    return facts, {} if result.smoothed is None else _facts(result.smoothed, result.truth)


def _document(result: Result, written: Sequence[Path]) -> dict[str, Any]:
    """Facts, warnings and written files, for programs."""
    facts, late = _measured(result)
    warnings = [{"code": one.code, "text": one.text} for one in result.warnings]
    return {**facts, "smoothed": late, "warnings": warnings, "written": [str(path) for path in written]}


def _print(result: Result) -> None:
    """Prints facts and warnings."""
    facts, late = _measured(result)
    columns = ["", result.settings.filter, *(["smoothed"] if late else [])]
    print_rows(columns, [_row(name, facts, late) for name in facts])
    for one in result.warnings:
        console.print(f"WARNING: {one.text}", style="bold red")


def _row(name: str, facts: Mapping[str, float], late: Mapping[str, float]) -> tuple[str, ...]:
    return name, number(facts[name]), *([number(late[name]) if name in late else ""] if late else [])


def _write_report(path: Path, title: str, result: Result) -> None:
    """Writes the figures and facts as one page."""
    facts: dict[str, Any] = _facts(result.best, result.truth) | _timing(result.track, result.imu, result.gnss)
    figures = [_track_figure(result)]
    if result.truth is not None:
        figures.append(error_figure(*_known(result.best, result.truth)))
    figures += [nis_figure(result.track, quantile(3, 0.95))] if result.track.fixes else []
    rows = {name: number(value) for name, value in facts.items()}
    rows |= {"warning": html.escape("; ".join(one.text for one in result.warnings))} if result.warnings else {}
    text = page(html.escape(title), figures, rows)
    write_output(path, text.encode())


def _track_figure(result: Result) -> go.Figure:
    true = None if result.truth is None else _known(result.track, result.truth)[1]
    return track_figure(result.track, result.gnss, true, result.smoothed)


def _study(filter_: str, seeds: int, out: Path | None, json: bool) -> None:
    """Runs the benchmark for one filter, and prints its table by sigma."""
    if filter_ not in FILTERS:
        raise UnknownNameError("filter of the study", filter_, FILTERS)
    cells, result = list(grid((filter_,))), {}
    with Progress(*Progress.get_default_columns(), MofNCompleteColumn(), console=console, disable=json) as bar:
        task = bar.add_task(f"localization, {filter_}", total=len(cells))
        for result in run_study(range(seeds), cells):
            bar.update(task, completed=result["done"][0])
    if out:
        write_results(out, result)
    if json:
        print_json(result)
        return
    console.print(f"within 0.5 m, % / RMSE, m; {seeds} seed{'s' * (seeds > 1)} on {', '.join(result['routes'])}")
    print_rows(*by_sigma(result["cells"], filter_))
    if out:
        console.print(f"all metrics with intervals: {out.resolve()}")


def _known(track: EstimatedTrack, true: PositionLog) -> tuple[EstimatedTrack, FloatArray]:
    """Part of a track with a known truth, and the truth at its times."""
    part = track.within(float(true.time[0]), float(true.time[-1]))
    if not len(part.time):
        raise InvalidInputError("expected a truth that overlaps the estimate in time, got none in common")
    return part, np.column_stack([np.interp(part.time, true.time, true.position[:, axis]) for axis in (0, 1)])


def _facts(track: EstimatedTrack, true: PositionLog | None) -> dict[str, float]:
    """Scores against the truth; none without."""
    if true is None:
        return {}
    part, reference = _known(track, true)
    error = part.position - reference
    nees = np.einsum("ki,kij,kj->k", error, np.linalg.inv(part.covariance), error)
    return {
        "within 0.5 m, %": accuracy(part.position, reference),
        "RMSE, m": rmse(part.position, reference),
        "95 % within, m": p95(part.position, reference),
        "largest error, m": max_drift(part.position, reference),
        "mean NEES (2 if consistent)": float(nees.mean()),
    }


def _timing(track: EstimatedTrack, imu: ImuLog, gnss: PositionLog) -> dict[str, float]:
    nis = track.nis
    facts = {
        "IMU samples": float(len(imu.time)),
        "fixes": float(len(gnss.time)),
        "fixes left out": float(track.rejected),
        "runs from t, s": float(track.time[0]),
        "us per IMU sample": track.step_us,
    }
    if len(nis):
        low, high = mean_bounds(3, len(nis))
        facts |= {"mean NIS": float(np.mean(nis)), "median NIS (2.4 if consistent)": float(np.median(nis))}
        facts |= {"mean NIS expected from": low, "mean NIS expected to": high}
    return facts
