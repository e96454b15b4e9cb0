"""The study of arms: the same scenarios for all, a line per drive and training, and going on where it stopped."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dohyo.agents.hierarchical import study
from dohyo.agents.hierarchical.study_tables import read_drives
from dohyo.evaluation.records.specifications import Status
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.hierarchical.drives import a_drive
from tests.agents.hierarchical.untrained import write_master, write_sub_policies

OBSTACLES = ["--benchmark", "obstacles", "--every", "159", "--arms"]


class MasterView:
    """An agent that says what it is told to."""

    def __init__(self, **judged: object) -> None:
        self.judged = judged

    def explain(self) -> dict[str, object]:
        return {"rss": self.judged}


def test_a_sample_takes_every_nth_scenario_of_the_cells_named():
    every = study.scenarios_of("precrash", ["vehicle", "lead"], [0, 1], 1)
    third = study.scenarios_of("precrash", ["vehicle", "lead"], [0, 1], 3)
    assert third == every[::3]
    assert all(one.cell.startswith("lead") for one in every)
    assert {one.seed for one in every} == {0, 1}
    with pytest.raises(InvalidInputError, match="'precrash' has no scenario in cells nowhere"):
        study.scenarios_of("precrash", ["nowhere"], [0], 1)


def test_who_learned_drives_once_per_training_and_the_rules_once():
    runs = Path("runs")
    found = study.drivers(["rules", "hrl-r", "ghrl-r", "flat"], runs, [0, 2])
    assert [(one.arm, one.seed, one.checkpoint) for one in found] == [
        ("rules", None, None),
        ("hrl-r", 0, runs / "hrl" / "seed-0"),
        ("hrl-r", 2, runs / "hrl" / "seed-2"),
        ("ghrl-r", 0, runs / "ghrl" / "seed-0"),
        ("ghrl-r", 2, runs / "ghrl" / "seed-2"),
        ("flat", 0, runs / "flat" / "seed-0"),
        ("flat", 2, runs / "flat" / "seed-2"),
    ]
    assert study.drivers(["ghrl"], None, [0, 2]) == [study.Driver("ghrl")]


@pytest.mark.parametrize("arm", ["hrl", "hrl-r", "ghrl", "flat"])
def test_a_training_that_is_not_there_is_named_before_anything_is_driven(tmp_path, arm):
    (who,) = study.drivers([arm], tmp_path / "runs", [1])
    folder = tmp_path / "runs" / study.ARMS[arm].trained / "seed-1"
    with pytest.raises(InvalidInputError, match=f"no '(master|flat)' in '{folder}'"):
        study.run(tmp_path / "out" / "precrash.jsonl", [study.Driver("autopilot"), who], [])
    assert not (tmp_path / "out").exists()


def test_a_stand_is_what_the_ego_stood_in_critical_intervals_up_to_now():
    agent = MasterView(critical=True)
    stand = study.Stand(agent)
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
    found = study.under_rules(status, agent, stood_s)
    assert found == {"critical_share": 0.2, "longest_standing_s": 40.0, "deadlock": deadlock}
    assert study.under_rules(status, MasterView(), stood_s) == {}


def test_what_was_driven_is_not_driven_again_but_what_the_simulation_lost_is(tmp_path, monkeypatch):
    scenarios = study.scenarios_of("precrash", ["lead"], [0], 1)[:2]
    path = tmp_path / "precrash.jsonl"
    driven = []

    def drive(who, scenario):
        driven.append((who.seed, scenario.name))
        status = "lost: simulation failed" if len(driven) == 1 else "completed"
        return a_drive(arm=who.arm, training_seed=who.seed, scenario=scenario.name, status=status)

    monkeypatch.setattr(study, "drive", drive)
    monkeypatch.setattr(study, "agent_of", lambda who: None)
    who = [study.Driver("ghrl", seed, tmp_path) for seed in (0, 1)]
    study.run(path, who[:1], scenarios)
    first, second = ((0, one.name) for one in scenarios)
    assert driven == [first, second]
    with path.open("a") as file:
        file.write('{"arm": "torn')
    study.run(path, who, scenarios)
    assert driven[2:] == [first, (1, scenarios[0].name), (1, scenarios[1].name)]
    kept = [json.loads(text) for text in path.read_text().splitlines()]
    assert len(kept) == 4
    assert {one["benchmark"] for one in kept} == {"precrash"}
    study.run(path, who, scenarios)
    assert len(driven) == 5


def test_tables_may_be_of_some_arms_alone(tmp_path, capsys):
    drives = [a_drive(arm=arm) for arm in ("rules", "ghrl", "ghrl-r")]
    (tmp_path / "precrash.jsonl").write_text("".join(json.dumps(one) + "\n" for one in drives))
    study.main(["--table", "--arms", "ghrl", "ghrl-r", "--out", str(tmp_path)])
    assert capsys.readouterr().out.startswith("| NoCrash success, % | ghrl | ghrl-r |\n")


def test_tables_alone_are_of_every_benchmark_there_is(tmp_path, capsys):
    for name in ("nocrash", "precrash"):
        (tmp_path / f"{name}.jsonl").write_text(json.dumps(a_drive(benchmark=name)) + "\n")
    study.main(["--table", "--out", str(tmp_path)])
    told = capsys.readouterr().out
    assert "| nocrash: a | 100 n=1 |" in told
    assert "| precrash: a | 100 n=1 |" in told
    study.main(["--table", "--benchmark", "nocrash", "--out", str(tmp_path)])
    assert "precrash" not in capsys.readouterr().out
    with pytest.raises(InvalidInputError, match=r"expected drives in BENCHMARK.jsonl, found none"):
        study.main(["--table", "--out", str(tmp_path / "none")])
    with pytest.raises(InvalidInputError, match="expected --benchmark, or --table"):
        study.main([])


def test_a_training_drives_and_its_line_says_which_and_what_the_rules_had_to_do(tmp_path):
    (who,) = study.drivers(["hrl-r"], tmp_path, [7])
    write_sub_policies(tmp_path / "hrl" / "seed-7")
    write_master(tmp_path / "hrl" / "seed-7")
    (scenario,) = study.scenarios_of("obstacles", [], [0], 159)
    one = study.drive(who, scenario.model_copy(update={"duration_s": 2.0}))
    assert (one["arm"], one["training_seed"], one["scenario"]) == ("hrl-r", 7, scenario.name)
    assert one["status"] == "finished"
    assert 0.0 <= one["critical_share"] <= 1.0
    assert one["deadlock"] is False


@pytest.mark.slow
def test_two_processes_drive_what_one_does(tmp_path):
    study.main([*OBSTACLES, "autopilot", "rules", "--workers", "2", "--out", str(tmp_path)])
    path = tmp_path / "obstacles.jsonl"
    autopilot, rules = sorted(read_drives(path), key=lambda one: one["arm"])
    assert autopilot["success"]
    assert autopilot["training_seed"] is None
    assert "critical_share" not in autopilot
    assert rules["critical_share"] >= 0.0
    assert rules["deadlock"] is False
    (scenario,) = study.scenarios_of("obstacles", [], [0], 159)
    assert {"benchmark": "obstacles", **study.drive(study.Driver("rules"), scenario)} == rules
