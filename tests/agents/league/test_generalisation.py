"""The study of generalisation: what a driver loses where it never was, beside one that learned nowhere."""

from __future__ import annotations

from functools import partial

import pytest

from dohyo.agents.league.study import generalisation
from dohyo.agents.league.study.generalisation import figure, gap_section
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.study import Results
from tests.agents.studies.failing import check_that_one_failed_drive_loses_its_cell_alone


def drives(arm: str, town: str, conditions: str, lawful: int, count: int = 10) -> list[Row]:
    return [
        {
            "arm": arm, "training_seed": None, "benchmark": "nocrash", "seed": 0, "status": "goal",
            "scenario": f"{town}.dense.{conditions}.m{i:02}", "success": 100.0,
            "lawful_success": 100.0 * (i < lawful),
        }
        for i in range(count)
    ]  # fmt: skip


def everywhere(arm: str, both_seen: int, both_unseen: int) -> list[Row]:
    places = {("town-train", "train"): both_seen, ("town-train", "test"): 7, ("town-test", "train"): 6}
    places["town-test", "test"] = both_unseen
    return [row for (town, conditions), lawful in places.items() for row in drives(arm, town, conditions, lawful)]


ROWS = [*everywhere("autopilot", 10, 8), *everywhere("rlad", 9, 1)]


def cells(line: str) -> list[str]:
    return [cell.split(" [")[0] for cell in line.strip("| ").split(" | ")]


def test_a_driver_loses_beyond_what_the_towns_cost() -> None:
    lines = gap_section(Results(ROWS, {})).splitlines()[2:]
    assert cells(lines[0])[-1] == cells(lines[1])[-1] == "—"
    assert cells(lines[1])[3:] == ["100.0", "70.0", "60.0", "80.0", "20.0", "—"]
    assert cells(lines[2])[3:] == ["100.0", "100.0", "100.0", "100.0", "0.0", "0.0"]
    assert cells(lines[3])[3:] == ["90.0", "70.0", "60.0", "10.0", "80.0", "60.0"]


def test_without_the_control_there_is_a_gap_and_nothing_beyond_it() -> None:
    lines = gap_section(Results(everywhere("rlad", 9, 1), {})).splitlines()[2:]
    assert [cells(line)[-1] for line in lines] == ["—", "—"]


def test_a_driver_that_has_not_been_everywhere_so_far_is_left_out() -> None:
    rows = [*everywhere("rlad", 9, 1), *drives("griad", "town-train", "train", 5)]
    assert {cells(line)[0] for line in gap_section(Results(rows, {})).splitlines()[2:]} == {"rlad"}
    assert {name for trace in figure(Results(rows, {})).data for name in trace.y} == {"rlad"}
    assert gap_section(Results(drives("griad", "town-train", "train", 5), {})) == ""


def test_the_largest_loss_stands_first() -> None:
    points = [trace for trace in figure(Results(ROWS, {})).data if trace.mode == "markers"]
    assert [list(trace.y) for trace in points] == [["rlad", "autopilot"]] * 2
    assert [list(trace.x) for trace in points] == [[90.0, 100.0], [10.0, 80.0]]


def test_a_drive_that_fails_is_lost_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    work = partial(generalisation.work, generalisation.Options())
    check_that_one_failed_drive_loses_its_cell_alone(
        monkeypatch, generalisation, work, Cell("autopilot", None, "nocrash", "", 0)
    )
