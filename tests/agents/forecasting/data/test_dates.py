"""Tables with dates in numbers: the order of day and month follows from all rows, or is asked for."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from dohyo.agents.forecasting.data.reading import Format, read_latest
from dohyo.sumo_networks.errors import InvalidInputError

DAY_FIRST, MONTH_FIRST = "%d/%m/%Y %H:%M", "%m/%d/%Y %H:%M"


def hours(first: datetime, count: int, form: str) -> list[str]:
    return [(first + timedelta(hours=hour)).strftime(form) for hour in range(count)]


def table(path: Path, times: list[str], name: str = "5 Minutes") -> Path:
    path.write_text(f"{name},speed\n" + "".join(f"{time},{20 + i % 5}\n" for i, time in enumerate(times)))
    return path


@pytest.mark.parametrize(
    ("first", "days", "form"),
    [
        (datetime(2026, 4, 3), 2, DAY_FIRST),
        (datetime(2026, 3, 4), 2, MONTH_FIRST),
        (datetime(2026, 3, 12), 2, MONTH_FIRST),
        (datetime(2026, 3, 31), 2, DAY_FIRST),
        (datetime(2026, 12, 31), 3, MONTH_FIRST),
        (datetime(2026, 3, 4), 9, "%m/%d/%Y %H:%M:%S"),
        (datetime(2026, 4, 3), 2, "%d.%m.%Y %H:%M"),
        (datetime(2026, 4, 3), 2, "%d-%m-%YT%H:%M:%S"),
        (datetime(2026, 4, 4), 1, MONTH_FIRST),
        (datetime(2026, 4, 3), 2, "%Y-%m-%d %H:%M"),
    ],
)
def test_all_rows_say_which_number_is_the_day(first: datetime, days: int, form: str, tmp_path: Path) -> None:
    grid = read_latest(table(tmp_path / "t.csv", hours(first, 24 * days, form)))
    assert (grid.start_s, grid.step_s) == (first.replace(tzinfo=UTC).timestamp(), 3600.0)
    assert len(grid.place) == 24 * days
    order = {"%d": "day/month/year", "%m": "month/day/year"}.get(form[:2])
    if first.day != first.month:
        assert [note for note in grid.notes if "dates" in note] == (
            [f"dates such as '{(first + timedelta(hours=24 * days - 1)).strftime(form)}' were read as {order}"]
            if order
            else []
        )


def test_one_day_of_two_meanings_is_refused_until_the_order_is_given(tmp_path: Path) -> None:
    path = table(tmp_path / "t.csv", hours(datetime(2026, 4, 3), 24, DAY_FIRST))
    message = "'03/04/2026 23:00' may be day/month/year or month/day/year.* --day-first or --month-first"
    with pytest.raises(InvalidInputError, match=message):
        read_latest(path)
    for day_first, month, day in ((True, 4, 3), (False, 3, 4)):
        grid = read_latest(path, Format(day_first=day_first))
        assert grid.start_s == datetime(2026, month, day, tzinfo=UTC).timestamp()


@pytest.mark.parametrize(
    ("times", "day_first", "message"),
    [
        (["03/25/2026 00:00", "25/03/2026 01:00"], None, "one order of day and month in all dates, got '03/25/2026"),
        (["03/04/2026 00:00", "2026-04-03 01:00"], None, "dates such as '03/04/2026 00:00', got '2026-04-03 01:00'"),
        (["03/04/2026 00:00", "03/25/2026 01:00"], True, "'03/25/2026 01:00' in column 'at', line 3, is no time"),
        (["2026-04-03 00:00", "yesterday"], None, "'yesterday' in column 'time', line 3, is no time"),
    ],
)
def test_dates_that_cannot_be_read_are_named(
    times: list[str], day_first: bool | None, message: str, tmp_path: Path
) -> None:
    name = "at" if "at'" in message else "time"
    with pytest.raises(InvalidInputError, match=message):
        read_latest(table(tmp_path / "t.csv", times, name), Format(day_first=day_first))
