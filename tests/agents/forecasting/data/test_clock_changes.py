"""Clocks that go back: local times have an hour twice, which offsets from UTC tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest

from dohyo.agents.forecasting.data.reading import read_latest
from dohyo.sumo_networks.errors import InvalidInputError

BERLIN = ZoneInfo("Europe/Berlin")
ASKS = r"line \d+ does not.*clocks go back by an hour there.* offset from UTC, .*\+01:00 after; else sort the rows"


def autumn(days: int, step_min: float = 5.0, late_s: Sequence[int] = (0,)) -> list[datetime]:
    """Local times from the day before the change of 2026 on."""
    start = datetime(2026, 10, 24, tzinfo=ZoneInfo("UTC"))
    steps = range(round(days * 1440 / step_min))
    late = [timedelta(seconds=late_s[i % len(late_s)]) for i in steps]
    return [(start + timedelta(minutes=step_min * i) + late[i]).astimezone(BERLIN) for i in steps]


def table(path: Path, times: Sequence[datetime], form: str = "%Y-%m-%d %H:%M:%S") -> Path:
    rows = [f"{time.strftime(form)},{20 + i % 7}" for i, time in enumerate(times)]
    path.write_text("\n".join(["time,speed", *rows]) + "\n")
    return path


@pytest.mark.parametrize("form", ["%Y-%m-%d %H:%M:%S", "%d.%m.%Y %H:%M:%S"])
@pytest.mark.parametrize(
    "times",
    [autumn(3), autumn(3, 1.0), autumn(3, 0.5), autumn(3, 30.0), autumn(3, 5.0, (0, 40, 13)), autumn(400, 30.0)],
)
def test_an_hour_that_comes_twice_needs_offsets(tmp_path: Path, times: Sequence[datetime], form: str) -> None:
    with pytest.raises(InvalidInputError, match=ASKS):
        read_latest(table(tmp_path / "t.csv", times, form))


def test_offsets_tell_the_two_hours_apart(tmp_path: Path) -> None:
    times = autumn(3)
    grid = read_latest(table(tmp_path / "t.csv", times, "%Y-%m-%dT%H:%M:%S%z"))
    assert (grid.steps, grid.notes) == (len(times), ())


def test_other_rows_in_disorder_are_to_be_sorted(tmp_path: Path) -> None:
    times = autumn(1)
    for disorder in (times[::-1], times[100:] + times[:100], [*times[:50], times[40], *times[50:]], times[:12] + times):
        with pytest.raises(InvalidInputError, match=r"line \d+ does not; sort the rows"):
            read_latest(table(tmp_path / "t.csv", disorder))


def test_two_hours_that_were_sorted_into_one_are_told(tmp_path: Path) -> None:
    times = sorted(autumn(3), key=lambda time: time.replace(tzinfo=None))
    notes = read_latest(table(tmp_path / "t.csv", times)).notes
    assert [note for note in notes if "from 2026-10-25 02:00 to 02:55" in note and "offset from UTC" in note]
    doubled = [time for time in autumn(1)[:200] for _ in range(2)]
    assert not [note for note in read_latest(table(tmp_path / "t.csv", doubled)).notes if "offset" in note]
