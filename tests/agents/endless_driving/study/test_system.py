"""Study of a system: jobs of one training that run at once, with a trainer and an agent that cost nothing."""

from __future__ import annotations

import json
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from dohyo.agents.endless_driving.study import system
from dohyo.agents.endless_driving.study.arms import DrivingArm
from dohyo.agents.endless_driving.study.system import LAST, study_of
from dohyo.agents.learning.runs.config import RunConfig
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import read_rows
from dohyo.agents.studies.study import ROWS
from dohyo.agents.studies.trained import TrainedOptions
from dohyo.evaluation.agent import Agent, AgentSpec
from dohyo.evaluation.running.lock import held
from dohyo.sumo_networks.scenario import Mission
from dohyo.sumo_networks.sensors import Observation
from tests.agents.studies.failing import check_that_one_failed_drive_loses_its_cell_alone

CHOSEN = ("held-out missions", "town-test.empty.test.m01")


class Refusing(Agent):
    """Ends its drive before the first tick."""

    spec = AgentSpec(name="refusing")

    def __init__(self, policy: str) -> None:
        self.policy = policy

    def reset(self, mission: Mission, seed: int) -> None:
        """Fails."""
        raise ValueError("does not drive")

    def act(self, observation: Observation) -> np.ndarray:
        """Is never called."""
        raise AssertionError


def train(config: RunConfig, order: TrainRequest) -> Path:
    """Takes half a second the first time, and keeps others out of its folder."""
    with held(order.out):
        policy = order.out / "best.onnx"
        if not policy.exists():
            time.sleep(0.5)
            header = ",".join(("steps", *LAST))
            (order.out / "evaluations.csv").write_text(f"{header}\n0{',1' * len(LAST)}\n")
            (order.out / "metrics.csv").write_text("steps\n")
            (order.out / "result.json").write_text(
                json.dumps({"steps": config.steps, "updates": 1, "finished": False, "tier": 3})
            )
            policy.touch()
    return policy


def test_two_jobs_of_one_training_end_with_two_workers(tmp_path: Path) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text("steps = 100\n")
    trainer = Trainer("a stand-in", RunConfig, train)
    study = study_of("", tmp_path, f"{__name__}:Refusing", trainer, {"one": DrivingArm("", settings)}, [])
    study.run(
        tmp_path / "out",
        [f"runs={tmp_path / 'runs'}"],
        chosen=lambda cell: cell.training_seed == 0 and cell.scenario in CHOSEN,
        workers=2,
    )
    rows = {row["scenario"]: row for row in read_rows(tmp_path / "out" / ROWS)}
    assert rows.keys() == set(CHOSEN)
    assert rows[CHOSEN[0]]["return"] == 1.0
    assert rows[CHOSEN[1]]["status"] == "failed: agent could not be set up"


def test_a_drive_that_fails_is_lost_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings, policy = tmp_path / "settings.toml", tmp_path / "one" / "seed-0" / "best.onnx"
    settings.write_text("steps = 100\n")
    policy.parent.mkdir(parents=True)
    policy.touch()
    (policy.parent / "result.json").write_text('{"steps": 100, "updates": 1, "finished": true, "tier": 3}')
    trainer = Trainer("a stand-in", RunConfig, train)
    study = study_of("", tmp_path, f"{__name__}:Refusing", trainer, {"one": DrivingArm("", settings)}, [])
    work = partial(study.work, TrainedOptions(runs=tmp_path, train=False))
    cell = Cell("one", 0, "nocrash", "", 0)
    check_that_one_failed_drive_loses_its_cell_alone(monkeypatch, system, work, cell)
