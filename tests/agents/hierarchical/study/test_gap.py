"""The gap of generalisation: shares by town and conditions."""

from __future__ import annotations

from dohyo.agents.hierarchical.study.gap import gap_section
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.study import Results


def drives(town: str, conditions: str, successes: int, *red: int, count: int = 10) -> list[Row]:
    return [
        {
            "arm": "a", "training_seed": 0, "benchmark": "nocrash", "scenario": f"{town}.{conditions}.m{i}", "seed": 0,
            "cell": f"{town}.dense.{conditions}", "success": i < successes,
            "infractions": ["red_light"] if i in red else [],
        }
        for i in range(count)
    ]  # fmt: skip


def test_each_place_has_its_column_and_lawful_success_its_line() -> None:
    rows = [
        *drives("town-train", "train", 10, 0),
        *drives("town-train", "test", 9),
        *drives("town-test", "train", 8),
        *drives("town-test", "test", 5, 0, 1),
    ]
    _, _, success, lawful = gap_section(Results(rows, {})).splitlines()
    assert [cell.split(" [")[0] for cell in success.strip("| ").split(" | ")[2:]] == [
        "100.0",
        "90.0",
        "80.0",
        "50.0",
        "50.0",
    ]
    assert [cell.split(" [")[0] for cell in lawful.strip("| ").split(" | ")[2:]] == [
        "90.0",
        "90.0",
        "80.0",
        "30.0",
        "60.0",
    ]


def test_an_arm_without_drives_in_one_place_is_left_out() -> None:
    assert gap_section(Results(drives("town-test", "test", 5), {})) == ""
