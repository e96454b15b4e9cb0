"""The study of arms: the same scenarios for all, a line per drive, and going on where it stopped."""

from __future__ import annotations

import pytest

from agents.hierarchical import study
from sumo_networks.errors import InvalidInputError

OBSTACLES = ["--benchmark", "obstacles", "--every", "159", "--arms"]


def a_drive(**changes: object) -> study.Drive:
    drive = {"arm": "rules", "cell": "a", "status": "completed", "success": True, "infractions": [], "duration_s": 10.0}
    return {**drive, **changes}


def test_a_sample_takes_every_nth_scenario_of_the_cells_named():
    every = study.scenarios_of("precrash", ["vehicle", "lead"], [0, 1], 1)
    third = study.scenarios_of("precrash", ["vehicle", "lead"], [0, 1], 3)
    assert third == every[::3]
    assert all(one.cell.startswith("lead") for one in every)
    assert {one.seed for one in every} == {0, 1}
    with pytest.raises(InvalidInputError, match="'precrash' has no scenario in cells nowhere"):
        study.scenarios_of("precrash", ["nowhere"], [0], 1)


def test_failures_are_counted_by_the_first_collision_or_by_the_ending():
    drives = [
        a_drive(),
        a_drive(success=False, status="failed: collision", infractions=["red_light", "collision_pedestrian"]),
        a_drive(success=False, status="failed: agent got blocked"),
    ]
    assert study.failures(drives) == {"collision_pedestrian": 1, "agent got blocked": 1}
    assert study.successes(drives).mean == pytest.approx(100 / 3)
    assert study.successes([*drives, a_drive(success=False, status="lost: simulation failed")]).n == 3


def test_the_table_has_a_row_per_cell_and_arm_and_weighs_critical_time_by_duration():
    drives = [
        a_drive(critical_share=0.5),
        a_drive(critical_share=0.0, duration_s=30.0),
        a_drive(arm="autopilot", cell="b", infractions=["red_light"]),
    ]
    rows = study.table(drives).splitlines()[2:]
    assert rows[0] == "| a | rules | 100 [34.2, 100] n=2 | none | 0 | 12.5 % |"
    assert rows[1] == "| b | autopilot | 100 n=1 | none | 1 | not watched |"
    assert [row.split(" | ")[1] for row in rows[2:]] == ["rules", "autopilot"]


def test_a_study_goes_on_where_it_stopped(tmp_path, capsys):
    study.main([*OBSTACLES, "autopilot", "--out", str(tmp_path)])
    (first,) = study.read_drives(tmp_path / "obstacles.jsonl")
    assert first["arm"] == "autopilot"
    assert first["success"]
    assert "critical_share" not in first
    with (tmp_path / "obstacles.jsonl").open("a") as file:
        file.write('{"arm": "torn')
    study.main([*OBSTACLES, "autopilot", "rules", "--out", str(tmp_path)])
    drives = study.read_drives(tmp_path / "obstacles.jsonl")
    assert [one["arm"] for one in drives] == ["autopilot", "rules"]
    assert drives[0] == first
    assert drives[1]["critical_share"] >= 0.0
    assert "| rules |" in capsys.readouterr().out
