"""Forecasts of a table that grows: when the next one is due, and the file that all of them are appended to."""

from __future__ import annotations

import csv
import io
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from dohyo.evaluation.output_file import unwritable
from dohyo.service.cli.output import plain, print_error
from dohyo.sumo_networks.errors import InvalidInputError

if TYPE_CHECKING:
    from dohyo.agents.forecasting.base import Forecaster
    from dohyo.agents.forecasting.data.grid import Grid
    from dohyo.agents.forecasting.live.now import Forecast

COLUMNS = ("made_at", "time", "segment", "speed", "low", "high", "unit")
"""Of the file of forecasts."""
LOOKED_AT = 2**22
"""Bytes at the end of that file in which a forecast is looked for that it may have already."""


class Outage:
    """What a command that goes on tells on standard error: each message once, whatever its numbers, until the end."""

    def __init__(self) -> None:
        self._told: set[str] = set()
        self._succeeded = False

    def tell(self, message: str) -> None:
        """Prints a message, unless one that differs in numbers alone was printed."""
        kind = re.sub(r"\d+", "", message)
        if kind not in self._told:
            self._told.add(kind)
            print_error(message)

    def end(self) -> None:
        """Forgets what was told."""
        self._told.clear()

    @contextmanager
    def passing(self, then: str) -> Iterator[None]:
        """Tells an error of a file, and what comes `then`, where such a block has succeeded before; else raises it."""
        try:
            yield
        except (InvalidInputError, OSError) as error:
            if not self._succeeded:
                raise
            why = (isinstance(error, OSError) and error.strerror) or error  # without the name of a temporary file
            self.tell(f"{why}; {then}")
        else:
            self._succeeded = True
            self.end()


def followed(
    read: Callable[[], Grid],
    load: Callable[[Grid], tuple[Grid, Forecaster]],
    every_s: float,
    idle_s: float | None,
    before: Callable[[], object] = lambda: None,
) -> Iterator[tuple[Grid, Forecast]]:
    """A table and its forecast, now and each time that a step has been added.

    An outage of the detectors, or a file that is not there for a while, is told once on standard error, whatever the
    numbers in its messages. So is a table that ends before its last forecast: its times have begun again, or a wrong
    date was removed. Steps after its new end are forecast.

    Args:
        read: Reads the table.
        load: Forecaster for a table, and the table with the columns in its order.
        every_s: Seconds between two readings.
        idle_s: Ends once no step was added for so many seconds; None: never.
        before: Called before each reading.

    Raises:
        InvalidInputError: The first reading failed, or the forecaster does not fit that table.
    """
    from dohyo.agents.forecasting.live.now import forecast_now

    outage = Outage()
    begun, last_s, grown_at = False, -float("inf"), time.monotonic()
    while idle_s is None or time.monotonic() - grown_at <= idle_s:
        before()
        try:
            grid = read()
            if grid.last_s < last_s - 0.5 * grid.step_s:  # less is a grid that has moved
                ends, last = moment(grid.last_s, grid.offset_s), moment(last_s, grid.offset_s)
                outage.tell(f"the table ends at {ends}, before the last forecast at {last}; going on from its end")
                last_s, grown_at = grid.last_s, time.monotonic()
            elif grid.last_s > last_s + 0.5 * grid.step_s:
                grid, forecaster = load(grid)
                begun, last_s, grown_at = True, grid.last_s, time.monotonic()
                yield grid, forecast_now(forecaster, grid)
                outage.end()
                grown_at = time.monotonic()
        except InvalidInputError as error:
            if not begun:
                raise
            outage.tell(f"{error}; looking again")
        time.sleep(every_s)


class ForecastFile:
    """A file of forecasts whose later ones wait while it cannot be written, as on a full disk; see `append_forecast`.

    Attributes:
        path: Of the file.
    """

    def __init__(self, path: Path, unit: str) -> None:
        self.path, self._unit = path, unit
        self._waiting: list[Forecast] = []
        self._outage = Outage()

    def append(self, forecast: Forecast) -> bool | None:
        """Appends a forecast and those that wait: whether a line was added, None where they wait now.

        Raises:
            InvalidInputError: It is the first one, and cannot be written.
        """
        self._waiting.append(forecast)
        with self._outage.passing("forecasts are appended as soon as it can be written"):
            return self.finish()
        return None

    def catch_up(self) -> None:
        """Tries again to append the forecasts that wait."""
        if self._waiting:
            self.append(self._waiting.pop())

    def finish(self) -> bool:
        """Appends the forecasts that wait: whether a line was added.

        Raises:
            InvalidInputError: The file cannot be written.
        """
        added = False
        while self._waiting:
            added |= append_forecast(self.path, self._waiting[0], self._unit)
            del self._waiting[0]
        return added


def append_forecast(path: Path, forecast: Forecast, unit: str) -> bool:
    """Appends a line per step and segment; a new or empty file begins with the names of the columns.

    A line that the file has already is not added, so that a command that starts again adds nothing twice. One with
    another speed, such as another model's, or with another unit is added. A last line without an end, which a killed
    command has left, is replaced.

    Returns:
        Whether a line was added.

    Raises:
        InvalidInputError: The file cannot be written, or holds something else than forecasts.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a+b") as file:
            _cut_last(file, path)
            there = _lines_at(file, moment(forecast.made_s, forecast.offset_s))
            text = io.StringIO(newline="")
            writer = csv.writer(text)
            if not file.tell():
                writer.writerow(COLUMNS)
            added = [line for line in _lines(forecast, unit) if line not in there]
            writer.writerows(added)
            file.write(text.getvalue().encode())
    except OSError as error:
        raise unwritable(path, error) from error
    return bool(added)


def moment(time_s: float, offset_s: float | None) -> str:
    """A time as in the table, with its offset from UTC if the table has a zone; bare minutes count from 1970."""
    if offset_s is None:
        return datetime.fromtimestamp(time_s, UTC).strftime("%Y-%m-%d %H:%M:%S")
    return datetime.fromtimestamp(time_s, timezone(timedelta(seconds=offset_s))).isoformat(" ", "seconds")


def _cut_last(file: BinaryIO, path: Path) -> None:
    """Removes a last line without an end from a file of forecasts, and refuses another file."""
    file.seek(0)
    first, header = file.readline(), ",".join(COLUMNS).encode()
    if first.rstrip(b"\r\n") != header and not (header + b"\r\n").startswith(first):
        raise InvalidInputError(
            f"'{path}': expected a new file or one of forecasts, which begins with {header.decode()}, got "
            f"'{plain(first[:60].decode(errors='replace').strip())}'"
        )
    start = max(0, file.seek(0, io.SEEK_END) - LOOKED_AT)
    file.seek(start)
    unfinished = len(file.read().rpartition(b"\n")[2])
    if unfinished:
        file.truncate(file.tell() - unfinished)


def _lines_at(file: BinaryIO, made_at: str) -> set[tuple[str, ...]]:
    """Lines at the end of a file that were forecast from one row."""
    file.seek(max(0, file.seek(0, io.SEEK_END) - LOOKED_AT))
    lines = csv.reader(file.read().decode(errors="replace").splitlines())
    return {tuple(line) for line in lines if line and line[0] == made_at}


def _lines(forecast: Forecast, unit: str) -> Iterator[tuple[str, ...]]:
    from dohyo.agents.forecasting.data.speed_table import UNITS

    for row, at in enumerate(forecast.times_s.tolist()):
        for column, name in enumerate(forecast.segments):
            ends = (forecast.ahead, forecast.low, forecast.high)
            speeds = [f"{float(end[row, column]) / UNITS[unit]:.3f}" for end in ends]
            yield moment(forecast.made_s, forecast.offset_s), moment(at, forecast.offset_s), name, *speeds, unit
