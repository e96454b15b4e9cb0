"""The study of GHRL's arms: its cells are those of the stored rows, and a drive's row says what the rules had to do."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.hierarchical.study import driving, study
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import cell_of, read_rows
from dohyo.evaluation.records.specifications import Status
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.hierarchical.untrained import write_master, write_sub_policies


class MasterView:
    """An agent that says what it is told to."""

    def __init__(self, **judged: object) -> None:
        self.judged = judged

    def explain(self) -> dict[str, object]:
        return {"rss": self.judged}


def test_the_stored_rows_are_the_cells_of_the_study_but_for_ten_that_were_never_driven():
    wanted, stored = set(study.cells(study.Options())), {cell_of(row) for row in read_rows(study.STUDY.stored)}
    assert stored <= wanted
    missing = wanted - stored
    assert {(cell.arm, cell.scenario.partition(".")[0]) for cell in missing} == {
        ("ghrl-pictures", "opposite-runs-red-light"), ("ghrl-r-pictures", "opposite-runs-red-light"),
    }  # fmt: skip
    assert len(missing) == 10


@pytest.mark.parametrize("arm", ["hrl", "ghrl", "flat"])
def test_a_training_that_is_not_there_is_named(tmp_path, arm):
    folder = tmp_path / study.ARMS[arm].trained / "seed-1"
    (cell,) = [one for one in study.cells(study.Options()) if one.arm == "hrl" and one.training_seed == 1][:1]
    with pytest.raises(InvalidInputError, match=f"no '(master|flat)' in '{folder}'"):
        list(study.work(study.Options(runs=tmp_path), [cell._replace(arm=arm)]))


def test_a_stand_is_what_the_ego_stood_in_critical_intervals_up_to_now():
    agent = MasterView(critical=True)
    stand = driving.Stand(agent)
    standing, rolling = ({"ego": {"speedometer": np.array([speed])}} for speed in (0.05, 2.0))
    for tick in range(101):
        stand.look(tick, standing)
    assert stand.seconds == 11.0
    stand.look(110, rolling)
    assert stand.seconds == 0.0
    stand.look(120, standing)
    agent.judged = {"critical": False}
    stand.look(121, standing)
    assert stand.seconds == 1.0
    stand.look(130, standing)
    assert stand.seconds == 0.0


@pytest.mark.parametrize(
    ("status", "stood_s", "deadlock"),
    [
        (Status.BLOCKED, 30.0, True),
        (Status.TIMED_OUT, 30.0, True),
        (Status.BLOCKED, 29.0, False),
        (Status.COLLIDED, 60.0, False),
        (Status.PERFECT, 60.0, False),
    ],
)
def test_a_deadlock_ends_a_drive_that_stood_long_under_rules(status, stood_s, deadlock):
    agent = MasterView(critical=True, critical_share=0.2, longest_standing_s=40.0, dangers=[])
    found = driving.under_rules(status, agent, stood_s)
    assert found == {"critical_share": 0.2, "longest_standing_s": 40.0, "deadlock": deadlock}
    assert driving.under_rules(status, MasterView(), stood_s) == {}


def test_a_training_drives_and_its_row_says_which_and_what_the_rules_had_to_do(tmp_path, monkeypatch):
    write_sub_policies(tmp_path / "ghrl" / "seed-7")
    write_master(tmp_path / "ghrl" / "seed-7")
    scenario = study.OBSTACLES.scenarios()[0].model_copy(update={"duration_s": 2.0})
    monkeypatch.setattr(study, "scenario_of", lambda cell: scenario)
    cell = Cell("ghrl-r", 7, "obstacles", scenario.name, 0)
    (row,) = study.work(study.Options(runs=tmp_path), [cell])
    assert cell_of(row) == cell
    assert row["status"] == "finished"
    assert 0.0 <= row["critical_share"] <= 1.0
    assert row["deadlock"] is False
    (without,) = study.work(study.Options(runs=tmp_path), [cell._replace(arm="ghrl")])
    assert "critical_share" not in without
