"""GRIAD in the unseen town: who drives where, and that a difference of all trainings is a verdict."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from dohyo.agents.gri.study import pictures, states, unseen
from dohyo.agents.gri.study.arms import ARMS
from dohyo.agents.gri.study.experts import prepare, problem_of
from dohyo.agents.gri.study.study import Options
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.study import Results
from dohyo.sumo_networks.errors import SimulationError
from tests.agents.studies.failing import check_that_one_failed_drive_loses_its_cell_alone

GRIAD, ALONE = "driving-full-iqn-p25", "driving-full-iqn-p0"
SHIPPED = Path(unseen.__file__).parents[1] / "checkpoints" / "griad.onnx"
CELLS = states.STUDY.cells(Options())


def rows(arm: str, successes: int) -> list[Row]:
    """Drives of all trainings, of which so many missions of 25 succeed in each amount of traffic."""
    return [
        {
            **cell._asdict(), "steps": 100_000, "updates": 25_000, "route_completion": 50.0, "driven_m": 500.0,
            "success": 100.0 * (int(cell.scenario.rpartition(".m")[2]) <= successes),
            "infractions": {"collision_vehicle": 1},
        }
        for cell in CELLS
        if cell.arm == arm
    ]  # fmt: skip


def test_all_arms_drive_the_same_missions_where_nobody_learned() -> None:
    arms = unseen.drivers("driving-full")
    missions = {arm: [cell.scenario for cell in CELLS if cell[:2] == (arm, 2)] for arm in arms}
    assert set(missions) == {name for name, arm in ARMS.items() if arm.problem == "driving-full"}
    assert len(missions[GRIAD]) == 75
    assert all(mission.startswith("town-test.") and ".test.m" in mission for mission in missions[GRIAD])
    assert len({tuple(one) for one in missions.values()}) == 1
    assert {problem_of(cell) for cell in CELLS} == {"driving-full"}


def test_tables_tell_success_beside_the_thesis_and_decide() -> None:
    results = Results([*rows(GRIAD, 20), *rows(ALONE, 10)], {})
    line = next(one for one in states.STUDY.tables["unseen"](results).splitlines() if "GRIAD" in one)
    assert line.startswith("| GRIAD, 3 to 1 | 3 | 100,000 | 225 | 80.0 [")
    assert line.endswith("| 68.7 / 63.3 / 52 |")
    assert "| IQN alone | 100,000 | 112.5 | 0.00 | 2.00 |" in unseen.infractions(results)
    claims = states.STUDY.tables["unseen-claims"](results)
    assert [one.split("|")[2].strip() for one in claims.splitlines()[2:]] == ["empty", "regular", "dense", ""]
    assert claims.count("reproduced") == 4


def test_no_success_in_25_missions_is_not_taken_for_none_ever() -> None:
    line = unseen.success({}, Results(rows(GRIAD, 0), {})).splitlines()[2]
    assert line.count("0.0 [0.0, 13.3]") == 3


def test_encoders_are_compared_on_the_same_missions_as_states() -> None:
    of_pictures = pictures.STUDY.cells(Options())
    arms = {cell.arm for cell in of_pictures}
    assert {ARMS[arm].problem for arm in arms} == {"driving-vis", "driving-vis-full"}
    assert {side for claim in pictures.CLAIMS for side in (claim.left, claim.right)} == arms
    assert {cell.scenario for cell in of_pictures} == {cell.scenario for cell in CELLS}
    results = Results([{**row, "arm": "driving-vis-iqn-affordances"} for row in rows(GRIAD, 20)], {})
    assert pictures.STUDY.tables["pictures"](results).splitlines()[-1].endswith("| \N{EM DASH} |")


def test_what_may_not_be_trained_drives_nowhere(tmp_path: Path) -> None:
    options = Options(runs=tmp_path, train=False)
    prepare(options, CELLS, 1)
    with pytest.raises(SimulationError, match="no policy in"):
        list(unseen.work(options, [Cell(GRIAD, 0, "nocrash", "town-test.empty.test.m01", 0)]))


def shipped_in(runs: Path) -> Options:
    """Options of runs whose only training has the shipped policy."""
    folder = runs / GRIAD / "seed-0"
    folder.mkdir(parents=True)
    (folder / "policy.onnx").write_bytes(SHIPPED.read_bytes())
    (folder / "result.json").write_text('{"steps": 70000, "updates": 17374}')
    return Options(runs=runs, train=False)


def test_a_drive_that_fails_is_lost_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    work = partial(unseen.work, shipped_in(tmp_path))
    check_that_one_failed_drive_loses_its_cell_alone(monkeypatch, unseen, work, Cell(GRIAD, 0, "nocrash", "", 0))


def test_the_shipped_policy_drives_a_mission(tmp_path: Path) -> None:
    options = shipped_in(tmp_path)
    (row,) = unseen.work(options, [Cell(GRIAD, 0, "nocrash", "town-test.empty.test.m01", 0)])
    assert (row["arm"], row["steps"]) == (GRIAD, 70_000)
    assert 0.0 < row["route_completion"] <= 100.0
