"""Tables of a study of endless driving, from rows made by hand; and the measures that a drive gives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from dohyo.agents.endless_driving.study.arms import DrivingArm, Reported
from dohyo.agents.endless_driving.study.system import last
from dohyo.agents.endless_driving.study.tables import tables_of
from dohyo.agents.rlad.study.arms import ARMS as RLAD
from dohyo.agents.rlad.study.arms import CLAIMS as RLAD_CLAIMS
from dohyo.agents.rlad.training import RladRunConfig
from dohyo.agents.rlfold.study.arms import ARMS as RLFOLD
from dohyo.agents.rlfold.study.arms import CLAIMS as RLFOLD_CLAIMS
from dohyo.agents.rlfold.training import RlfoldRunConfig
from dohyo.agents.studies.claims import Claim
from dohyo.agents.studies.study import Results

ARMS = {"one": DrivingArm("", Path(), (), Reported(90.0, 60.0)), "two": DrivingArm("less", Path())}


def drive(arm: str, training: int, mission: int, success: float, **more: Any) -> dict[str, Any]:
    facts = {"arm": arm, "training_seed": training, "benchmark": "nocrash", "seed": 0, "status": "completed"}
    place = {"scenario": f"town-test.regular.test.m{mission:02d}", "success": success, "lawful_success": 0.0}
    rest = {"route_completion": 100.0, "driven_m": 500.0, "decision_ms": 1.5, "lateral_ticks": [30] + [0] * 7 + [10]}
    return {**facts, **place, **rest, "infractions": {"red_light": 2}, **more}


def test_success_infractions_offsets_and_the_verdict_come_from_the_drives() -> None:
    rows = [
        drive(arm, seed, mission, 100.0 * (arm == "one")) for arm in ARMS for seed in range(3) for mission in range(12)
    ]
    tables = tables_of(ARMS, [Claim("one", ">", "two", "success", "regular")])
    made = {name: table(Results(rows, {})) for name, table in tables.items()}
    first = made["success"].splitlines()[2]
    assert first.split("|")[1:4] == [" one ", " 3 ", " 36 "]
    assert "100.0" in first.split("|")[5]  # regular
    assert "0.0" in first.split("|")[8]  # lawful, regular
    assert "90 / 60 / —" in first
    assert "reproduced" in made["claims"]
    assert made["infractions"].splitlines()[2].split("|")[3].strip() == "18.0"
    assert made["infractions"].splitlines()[2].split("|")[7].strip() == "4.00"  # red lights per km
    assert made["lateral"].splitlines()[2].split("|")[2].strip() == "75.0"
    assert made["trainings"] == ""


def test_a_share_of_equal_drives_has_wilsons_interval() -> None:
    rows = [drive("one", 0, mission, 100.0) for mission in range(25)]
    line = tables_of(ARMS, ())["success"](Results(rows, {})).splitlines()[2].split("|")
    assert (line[5].strip(), line[8].strip()) == ("100.0 [86.7, 100.0]", "0.0 [0.0, 13.3]")


@pytest.mark.parametrize(
    ("arms", "claims", "kind"), [(RLAD, RLAD_CLAIMS, RladRunConfig), (RLFOLD, RLFOLD_CLAIMS, RlfoldRunConfig)]
)
def test_every_arm_can_be_trained_and_every_claim_is_about_arms(arms: Any, claims: Any, kind: Any) -> None:
    made = {name: arm.training(kind, 1) for name, arm in arms.items()}
    assert len({config.model_dump_json() for config in made.values()}) == len(made)
    assert {name for claim in claims for name in (claim.left, claim.right)} <= made.keys()


def test_the_last_evaluation_has_the_curves_slope_and_the_experts_share(tmp_path: Path) -> None:
    names = ("return", "success", "completion", "lateral_m", "collision", "red_lights", "left_route", "blocked")
    lines = [f"steps,{','.join(names)}", f"0,{','.join(['1'] * 8)}", f"5000,{','.join(['3'] * 8)}"]
    (tmp_path / "evaluations.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "metrics.csv").write_text("steps,demonstrated_steps\n1000,0.75\n2000,\n")
    found = last(tmp_path)
    assert (found["return"], found["slope"], found["expert_share"]) == (3.0, 4.0, 0.75)
