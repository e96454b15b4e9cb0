"""The parking study: facts of trainings, judgement of a policy, and its tables."""

from __future__ import annotations

import json

import numpy as np
import pytest

from dohyo.agents.parking.study import judging
from dohyo.agents.parking.study.arms import ARMS, EXPERT
from dohyo.agents.parking.study.judging import judged
from dohyo.agents.parking.study.study import Options, cells, training_facts, work
from dohyo.agents.parking.study.tables import arms_table, claims
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.study import Results
from dohyo.sumo_networks.errors import SimulationError


def row(arm, training, block, success, **more):
    measures = {"success": success, "aligned": 90.0, "collided": 0.0, "timed_out": 0.0, "time_s": None}
    told = {"steps": 1000, "finished": training != 1, "threshold_steps": 500 if training == 0 else None}
    return {**Cell(arm, training, "parking-complex", f"block-{block}", block)._asdict(), **told, **measures, **more}


def test_the_steps_to_the_threshold_are_those_of_the_first_evaluation_above_it(tmp_path):
    (tmp_path / "evaluations.csv").write_text("steps,success\n0,10\n100,89.9\n200,90.0\n300,80\n")
    (tmp_path / "result.json").write_text(json.dumps({"finished": False}))
    assert training_facts(tmp_path) == {"steps": 300, "finished": False, "threshold_steps": 200}


def test_a_policy_that_stands_parks_nowhere_and_the_expert_everywhere(monkeypatch):
    monkeypatch.setattr(judging, "LOTS", 2)
    stands = judged(lambda seen: np.tile(np.float32([0, 0, 1]), (len(seen["observation"]), 1)), "parking-simple", 0)
    assert (stands["success"], stands["timed_out"], stands["time_s"]) == (0.0, 100.0, None)
    expert = judged(None, "parking-simple", 0)
    assert (expert["success"], expert["aligned"], expert["collided"]) == (100.0, 100.0, 0.0)


def test_an_arm_without_a_policy_is_lost_and_says_why(tmp_path):
    job = [Cell("ppo", 0, "parking-complex", "block-0", 0)]
    with pytest.raises(SimulationError, match="no policy in"):
        list(work(Options(runs=tmp_path, train=False), job))


def test_every_arm_has_cells_and_settings_that_exist():
    wanted = cells(Options())
    assert {cell.arm for cell in wanted} == set(ARMS)
    assert {cell.training_seed for cell in wanted if cell.arm == EXPERT} == {None}
    for name in ARMS.keys() - {EXPERT}:
        assert ARMS[name].config(1).seed == 1


def test_tables_say_what_is_unfinished_and_judge_directions():
    rows = [row("ppo", training, block, 20.0 + block) for training in (0, 1, 2) for block in range(8)]
    rows += [row("dppo", training, block, 80.0 + block) for training in (0, 1, 2) for block in range(8)]
    table = arms_table(Results(rows, {}))
    assert "3, 1 unfinished" in table
    assert "500, never, never" in table
    assert "74.8" in table
    (verdict,) = [line for line in claims(Results(rows, {})).splitlines() if "dppo > ppo" in line]
    assert "reproduced" in verdict


def test_a_training_that_never_reaches_the_threshold_counts_with_all_its_steps():
    place = {"benchmark": "parking-simple, reached"}
    reached = {"simple-ppo": (300, 320, 310), "simple-poca": (None, 900, None)}
    rows = [
        row(arm, training, block, 99.0, threshold_steps=steps, **place)
        for arm, ends in reached.items()
        for training, steps in enumerate(ends)
        for block in range(8)
    ]
    (verdict,) = [line for line in claims(Results(rows, {})).splitlines() if "simple-ppo < simple-poca" in line]
    assert "-657" in verdict
    assert "n=3" in verdict


def aligned_cell(rows):
    (line,) = arms_table(Results(rows, {})).splitlines()[2:]
    return line.split(" | ")[6]


def test_the_share_of_successes_that_is_aligned_is_uncertain_by_the_number_of_successes():
    parked = {0: 3.0, 1: 4.0, 2: 1.0, 3: 0.0}
    rows = [row("ppo", 0, block, share, aligned=0.0 if share else None) for block, share in parked.items()]
    assert aligned_cell(rows) == "0.0 [0.0, 32.4]"  # Wilson's of none of 8
    # The same lots, driven by a second training, are no more lots; one without a success has no value.
    rows += [row("ppo", 1, block, min(share, 2.0), aligned=0.0 if share else None) for block, share in parked.items()]
    rows += [row("ppo", 2, block, 0.0, aligned=None) for block in parked]
    assert aligned_cell(rows) == "0.0 [0.0, 32.4], 2 of 3 trainings"


def test_an_arm_that_never_parks_has_no_share_of_successes():
    assert aligned_cell([row("ppo", 0, block, 0.0, aligned=None) for block in range(3)]) == "\N{EM DASH}"
