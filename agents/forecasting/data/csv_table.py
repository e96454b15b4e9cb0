"""Tables as CSV: their complete lines, the names of their columns, and a clear error for other separators."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import polars as pl

from dohyo.agents.forecasting.data.dates import is_numeric
from dohyo.sumo_networks.errors import InvalidInputError

NULLS = ["", "nan", "NaN", "NA", "N/A", "n/a", "#N/A", "null", "NULL", "None", "-"]
SEPARATORS = {";": "';'", "\t": "a tab"}
"""Of columns in other tables than ours; neither can be part of a time or a speed."""


def read_csv(path: Path, lines: bytes) -> pl.DataFrame:
    """A table whose columns are separated by commas.

    Args:
        path: Of the file, for messages.
        lines: Its `whole_lines`.

    Raises:
        InvalidInputError: The text is in UTF-16, or something else separates the columns.
        polars.exceptions.PolarsError: The file is no table.
        csv.Error: The first line cannot be split.
    """
    header, _, rows = lines.partition(b"\n")
    row = rows.partition(b"\n")[0]
    if b"\0" in header:
        raise InvalidInputError(
            f"'{path}': expected text in UTF-8, got UTF-16 as of Excel's 'Unicode text'; save it as CSV UTF-8"
        )
    for separator, name in SEPARATORS.items():
        if 0 < header.count(separator.encode()) == row.count(separator.encode()):
            raise InvalidInputError(f"'{path}': expected columns separated by commas, got {name} in line 1")
    first = row.partition(b",")[0].strip(b'" ').decode(errors="replace")
    parse = not is_numeric(first)  # polars takes the day as first whatever the other rows say
    frame = pl.read_csv(lines, infer_schema_length=None, null_values=NULLS, try_parse_dates=parse)
    doubled = {name.replace('"', '""'): name for name in _cells(header)}  # polars leaves quotes in names doubled
    return frame.rename({name: doubled.get(name, name) for name in frame.columns})


def whole_lines(path: Path, growing: bool) -> bytes:
    """A file without an incomplete last row, which a logger may be about to write.

    Args:
        path: Of the file.
        growing: Whether a last row without an end is always incomplete; else only one that lacks columns.

    Raises:
        OSError: The file cannot be read.
        csv.Error: The first or the last line cannot be split.
    """
    whole, newline, last = path.read_bytes().rpartition(b"\n")
    if growing:
        return whole + newline
    names = _cells(whole.partition(b"\n")[0])
    complete = not newline or (len(_cells(last)) == len(names) and not last.endswith(b","))
    return whole + newline + last if complete else whole + newline


def _cells(line: bytes) -> list[str]:
    """Texts between the commas of a line; a name in quotes may hold commas and doubled quotes."""
    text = line.decode("utf-8-sig", errors="replace")
    return next(csv.reader(io.StringIO(text, newline=None)), [])
