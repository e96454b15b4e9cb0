"""`dohyo localize`: a vehicle's track from real IMU and GNSS logs, and the benchmark of the filters."""

from __future__ import annotations

import html
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.progress import MofNCompleteColumn, Progress

from dohyo.agents.localization.consistency import mean_bounds, quantile
from dohyo.agents.localization.localizer import Localizer, Settings
from dohyo.agents.localization.logs import ImuLog, PositionLog, check_together, read_imu, read_positions
from dohyo.agents.localization.lowpass import ALPHA
from dohyo.agents.localization.study.figures import error_figure, nis_figure, page, track_figure
from dohyo.agents.localization.study.grid import FILTERS, grid, write_results
from dohyo.agents.localization.study.grid import study as run_study
from dohyo.agents.localization.study.tables import by_sigma
from dohyo.agents.localization.track import EstimatedTrack, follow
from dohyo.evaluation.scores.localization import accuracy, max_drift, p95, rmse
from dohyo.service.cli.output import Json, console, number, print_json, print_rows
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.files import write_atomically


def localize(
    imu: Annotated[
        Path | None, typer.Option(help="CSV: t, ax, ay, az, gx, gy, gz (SI; x forward, y left, z up).")
    ] = None,
    gnss: Annotated[Path | None, typer.Option(help="CSV: t, lat, lon, alt (degrees, m) or t, x, y, z (m).")] = None,
    truth: Annotated[Path | None, typer.Option(help="CSV like --gnss, to score the estimate against.")] = None,
    out: Annotated[Path | None, typer.Option(help="Write an HTML report with the track.")] = None,
    filter_: Annotated[str, typer.Option("--filter", help="es-ekf, ekf, ukf or imu.")] = "es-ekf",
    sigma: Annotated[float, typer.Option(min=0.001, help="Standard deviation of a fix, m.")] = 2.1,
    alpha: Annotated[float, typer.Option(min=0.0, max=0.99, help="Low-pass coefficient; 0: no filter.")] = ALPHA,
    standing: Annotated[float, typer.Option(min=0.3, help="Seconds for which the vehicle stands at the start.")] = 3.0,
    calibrate: Annotated[bool, typer.Option(help="Measure the IMU's offsets while the vehicle stands.")] = True,
    study: Annotated[bool, typer.Option("--study", help="Run the benchmark 'localization' instead; no logs.")] = False,
    seeds: Annotated[int, typer.Option(min=1, help="Number of error seeds of --study, each on three routes.")] = 1,
    json: Json = False,
) -> None:
    """Estimates a vehicle's track from IMU and GNSS logs. It must stand level at first.

    With --study it runs the benchmark 'localization' on simulated logs: calibration and low-pass filter, GNSS rate and
    error, one filter.
    """
    if study:
        _study(filter_, seeds, out, json)
        return
    if imu is None or gnss is None:
        raise InvalidInputError("expected --imu and --gnss, or --study")
    samples, fixes = read_imu(imu), read_positions(gnss)
    true = read_positions(truth, fixes.origin) if truth else None
    if true and (true.origin is None) != (fixes.origin is None):
        raise InvalidInputError(f"'{truth}' and '{gnss}': expected both in degrees or both in metres")
    check_together(samples, fixes)
    settings = Settings(filter=filter_, calibrate=calibrate, alpha=alpha, standing_s=standing, gnss_sigma_m=sigma)
    track = follow(Localizer(settings), samples.time, samples.samples, fixes.fixes())
    within, reference = _reference(track, true) if true else (track, None)
    facts = _facts(within, reference) | _timing(track, samples, fixes)
    if out:
        figures = [track_figure(track, fixes, reference)]
        figures += [error_figure(within, reference)] if reference is not None else []
        figures += [nis_figure(track, quantile(3, 0.95))] if track.innovations else []
        text = page(f"Localization: {html.escape(imu.name)}", figures, {k: number(v) for k, v in facts.items()})
        try:
            out.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(out, text.encode())
        except OSError as error:
            raise InvalidInputError(f"cannot write '{out}': {error.strerror}") from error
    if json:
        print_json(facts)
        return
    print_rows(["", settings.filter], [(name, number(value)) for name, value in facts.items()])
    if out:
        console.print(f"report: {out.resolve()}")


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


def _reference(track: EstimatedTrack, true: PositionLog) -> tuple[EstimatedTrack, FloatArray]:
    """Part of a track with a known truth, and the truth at its times."""
    inside = (track.time >= true.time[0]) & (track.time <= true.time[-1])
    if not inside.any():
        raise InvalidInputError("expected a truth that overlaps the estimate in time, got none in common")
    part = EstimatedTrack(
        row=track.row[inside],
        time=track.time[inside],
        position=track.position[inside],
        heading=track.heading[inside],
        covariance=track.covariance[inside],
        innovations=track.innovations,
        rejected=track.rejected,
        step_us=track.step_us,
    )
    at = [np.interp(part.time, true.time, true.position[:, axis]) for axis in (0, 1)]
    return part, np.column_stack(at)


def _facts(track: EstimatedTrack, reference: FloatArray | None) -> dict[str, float]:
    if reference is None:
        return {}
    error = track.position - reference
    nees = np.einsum("ki,kij,kj->k", error, np.linalg.inv(track.covariance), error)
    return {
        "within 0.5 m, %": accuracy(track.position, reference),
        "RMSE, m": rmse(track.position, reference),
        "95 % within, m": p95(track.position, reference),
        "largest error, m": max_drift(track.position, reference),
        "mean NEES (2 if consistent)": float(nees.mean()),
    }


def _timing(track: EstimatedTrack, imu: ImuLog, gnss: PositionLog) -> dict[str, float]:
    nis = [one.nis for one in track.innovations]
    facts = {
        "IMU samples": float(len(imu.time)),
        "fixes": float(len(gnss.time)),
        "fixes left out": float(track.rejected),
        "runs from t, s": float(track.time[0]),
        "us per IMU sample": track.step_us,
    }
    if nis:
        low, high = mean_bounds(3, len(nis))
        facts |= {"mean NIS": float(np.mean(nis)), "NIS expected from": low, "NIS expected to": high}
    return facts
