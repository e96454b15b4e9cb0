"""The parking study: facts of trainings, judgement of a policy, and its tables."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from dohyo.agents.parking.study import judging
from dohyo.agents.parking.study.arms import ARMS, EXPERT
from dohyo.agents.parking.study.judging import judged
from dohyo.agents.parking.study.study import Options, cells, training_facts, work
from dohyo.agents.parking.study.tables import arms_table, claims, rank_test
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


def steps_verdict(claim, **reached):
    rows = [
        row(arm.replace("_", "-"), training, block, 99.0, threshold_steps=steps, benchmark="parking-simple, reached")
        for arm, ends in reached.items()
        for training, steps in enumerate(ends)
        for block in range(8)
    ]
    (line,) = [line for line in claims(Results(rows, {})).splitlines() if line.startswith(f"| {claim}")]
    return line.strip("| ").split(" | ")


def test_a_training_that_never_reaches_the_threshold_counts_with_all_its_steps():
    told = steps_verdict(
        "simple-ppo < simple-poca", simple_ppo=(300, 320, 310), simple_poca=(None, 900, None)
    )  # all take 1,000
    assert told[0] == "simple-ppo < simple-poca (at most: not all trainings reach it)"
    assert told[2] == "-657 n=3"


def test_trainings_that_never_reach_the_threshold_show_no_spread_that_proves_anything():
    never, reached = (None, None, None), (310, 300, 305)
    (claim, _, difference, p, said) = steps_verdict("simple-sac > simple-poca", simple_sac=never, simple_poca=reached)
    assert claim == "simple-sac > simple-poca (at least: not all trainings reach it)"
    assert (difference, p, said) == ("695 n=3", "0.20", "not resolved")  # 0.1, of two claims
    both = steps_verdict("simple-sac > simple-poca", simple_sac=never, simple_poca=(None, 300, None))
    assert both[0].endswith("(no bound: not all trainings reach it)")
    assert both[4] == "not resolved"


def test_steps_that_all_trainings_reached_are_judged_by_their_differences():
    told = steps_verdict("simple-sac > simple-poca", simple_sac=(902, 900, 901), simple_poca=(303, 302, 301))
    assert told[0] == "simple-sac > simple-poca"
    assert told[4] == "reproduced"


def test_the_order_of_two_samples_has_the_exact_p_value():
    assert rank_test([4, 5, 6], [1, 2, 3]) == pytest.approx(2 / 20)
    assert rank_test([1, 2, 3, 4], [5, 6, 7, math.inf]) == pytest.approx(2 / 70)
    assert rank_test([math.inf] * 3, [math.inf] * 3) == 1.0
    assert rank_test([2], [1, 3]) == 1.0


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
