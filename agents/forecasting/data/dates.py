"""Dates in numbers, such as 03/04/2026: all of a column decides whether the day or the month comes first."""

from __future__ import annotations

import polars as pl

from dohyo.sumo_networks.errors import InvalidInputError

NUMERIC = r"^\s*(\d{1,2})[/.-](\d{1,2})[/.-](\d{4})(?:[ T]+(.*))?$"
"""Two numbers for day and month, the year, and the time of day if there is one."""
ORDERS = {True: "day/month/year", False: "month/day/year"}
MONTHS = 12


def is_numeric(text: str) -> bool:
    """Whether a text is a date in numbers that does not begin with the year."""
    return bool(pl.Series([text]).str.contains(NUMERIC)[0])


def year_first(column: pl.Series, day_first: bool | None = None) -> tuple[pl.Series, str]:
    """Dates as year-month-day with their times, and a sentence about the order that was taken.

    A number above 12 is a day. Where there is none, the numbers that change from row to row are days: the rows of a
    table lie closer together in the right order.

    Args:
        column: Dates in numbers.
        day_first: Order of day and month, if known.

    Raises:
        InvalidInputError: A text is no such date, or both orders are possible.
    """
    parts = pl.DataFrame({"text": column}).select(
        pl.col("text").str.extract(NUMERIC, group).alias(name)
        for group, name in enumerate(("first", "second", "year", "clock"), 1)
    )
    if parts["year"].null_count():
        row = int(parts["year"].is_null().arg_max() or 0)
        raise InvalidInputError(f"expected dates such as '{column[0]}', got '{column[row]}'")
    numbers = parts.select(pl.col("first", "second", "year").cast(pl.Int32), pl.col("clock").fill_null(""))
    order = _order(column, numbers) if day_first is None else day_first
    names = ("second", "first") if order else ("first", "second")
    iso = numbers.select(
        pl.format(
            "{}-{}-{} {}", "year", *(pl.col(name).cast(pl.String).str.zfill(2) for name in names), "clock"
        ).str.strip_chars()
    ).to_series()
    return iso.alias(column.name), f"dates such as '{column[-1]}' were read as {ORDERS[order]}"


def _order(column: pl.Series, numbers: pl.DataFrame) -> bool:
    """Whether the day comes first."""
    spans = {}
    for day_first, month, day in ((True, "second", "first"), (False, "first", "second")):
        if int(numbers[month].max()) <= MONTHS:  # type: ignore[arg-type]
            ordinal = numbers.select(372 * pl.col("year") + 31 * pl.col(month) + pl.col(day)).to_series()
            spans[day_first] = int(ordinal.max()) - int(ordinal.min())  # type: ignore[arg-type]
    if not spans:
        raise InvalidInputError(f"expected one order of day and month in all dates, got '{column[0]}', '{column[-1]}'")
    if len(set(spans.values())) < len(spans) and (numbers["first"] != numbers["second"]).any():
        raise InvalidInputError(
            f"'{column[-1]}' may be {' or '.join(ORDERS.values())}, and no row says which: write the year first, or "
            "give --day-first or --month-first"
        )
    return min(spans, key=lambda day_first: spans[day_first])
