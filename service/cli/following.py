"""Forecasts of a table that grows: when the next one is due, and the file that all of them are appended to."""

from __future__ import annotations

import csv
import sys
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import TYPE_CHECKING

from dohyo.evaluation.output_file import unwritable
from dohyo.service.cli.output import plain
from dohyo.sumo_networks.errors import InvalidInputError

if TYPE_CHECKING:
    from dohyo.agents.forecasting.base import Forecaster
    from dohyo.agents.forecasting.data.grid import Grid
    from dohyo.agents.forecasting.live.now import Forecast

COLUMNS = ("made_at", "time", "segment", "speed", "low", "high", "unit")
"""Of the file of forecasts."""
LOOKED_AT = 2**22
"""Bytes at the end of that file in which a forecast is looked for that it may have already."""


def followed(
    read: Callable[[], Grid], load: Callable[[Grid], Forecaster], every_s: float, idle_s: float | None
) -> Iterator[tuple[Grid, Forecast]]:
    """A table and its forecast, now and each time that a step has been added.

    An outage of the detectors, or a file that is not there for a while, is told once on standard error.

    Args:
        read: Reads the table.
        load: Forecaster for a table.
        every_s: Seconds between two readings.
        idle_s: Ends once no step was added for so many seconds; None: never.

    Raises:
        InvalidInputError: The first reading failed, or the forecaster does not fit that table.
    """
    from dohyo.agents.forecasting.live.now import forecast_now

    begun, told, last_s, grown_at = False, "", -float("inf"), time.monotonic()
    while idle_s is None or time.monotonic() - grown_at <= idle_s:
        try:
            grid = read()
            if grid.last_s > last_s:
                forecaster = load(grid)
                begun, last_s, grown_at = True, grid.last_s, time.monotonic()
                yield grid, forecast_now(forecaster, grid)
                told, grown_at = "", time.monotonic()
        except InvalidInputError as error:
            if not begun:
                raise
            if str(error) != told:
                told = str(error)
                print(f"dohyo: {plain(told)}; looking again", file=sys.stderr)
        time.sleep(every_s)


def append_forecast(path: Path, forecast: Forecast, unit: str) -> list[Path]:
    """Appends a line per step and segment; a new file begins with the names of the columns.

    What the file has of the same row of the same segment stays, so that a command that starts again adds nothing twice.

    Returns:
        The path.

    Raises:
        InvalidInputError: The file cannot be written.
    """
    try:
        new = not path.exists()
        path.parent.mkdir(parents=True, exist_ok=True)
        there: set[str] = set() if new else _segments_at(path, moment(forecast.made_s, forecast.offset_s))
        with path.open("a", newline="") as file:
            writer = csv.writer(file)
            if new:
                writer.writerow(COLUMNS)
            writer.writerows(line for line in _lines(forecast, unit) if line[2] not in there)
    except OSError as error:
        raise unwritable(path, error) from error
    return [path]


def moment(time_s: float, offset_s: float | None) -> str:
    """A time as in the table, with its offset from UTC if the table has a zone; bare minutes count from 1970."""
    if offset_s is None:
        return datetime.fromtimestamp(time_s, UTC).strftime("%Y-%m-%d %H:%M:%S")
    return datetime.fromtimestamp(time_s, timezone(timedelta(seconds=offset_s))).isoformat(" ", "seconds")


def _segments_at(path: Path, made_at: str) -> set[str]:
    """Segments of which the end of a file has the forecast of one row."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - LOOKED_AT))
        lines = csv.reader(file.read().decode(errors="replace").splitlines())
        return {line[2] for line in lines if len(line) == len(COLUMNS) and line[0] == made_at}


def _lines(forecast: Forecast, unit: str) -> Iterator[list[str]]:
    from dohyo.agents.forecasting.data.speed_table import UNITS

    for row, at in enumerate(forecast.times_s.tolist()):
        for column, name in enumerate(forecast.segments):
            ends = (forecast.ahead, forecast.low, forecast.high)
            speeds = [f"{float(end[row, column]) / UNITS[unit]:.3f}" for end in ends]
            yield [moment(forecast.made_s, forecast.offset_s), moment(at, forecast.offset_s), name, *speeds, unit]
