"""The trainer of parking: resumption to the bit, its parts, and clear errors."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from dohyo.agents.learning.files.report import Report
from dohyo.agents.learning.imitation.bco import BcoConfig, InverseDynamicsConfig
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.parking.training.dppo_il import PARKING, DemonstrationsConfig, ParkingConfig
from dohyo.agents.parking.training.task import ParkingTask
from dohyo.sumo_networks.errors import InvalidInputError

SMALL = ParkingConfig(
    environments=4, lots=2, steps=64, evaluate_every=32, checkpoint_every=16, device="cpu", tensorboard=False,
    scene="simple", reward="simple", bco=True, gail=True, curiosity=True,
    demonstrations=DemonstrationsConfig(episodes=2),
    cloning=BcoConfig(experience="demonstrated", inverse=InverseDynamicsConfig(epochs=1), passes=1),
)  # fmt: skip
SMALL = SMALL.model_copy(update={"ppo": SMALL.ppo.model_copy(update={"horizon": 4, "hidden": (8,), "batch": 8})})


class KilledError(Exception):
    """The end of a process, as far as a run's folder shows."""


def rows(folder: Path) -> list[list[str]]:
    return list(csv.reader((folder / "metrics.csv").open()))


def test_dppo_il_that_is_killed_and_resumed_equals_one_that_is_not(tmp_path):
    def killed(report: Report) -> None:
        if report.steps == 48:
            raise KilledError

    def train(folder: Path, resume: bool, report=lambda told: None) -> Path:
        return PARKING.train(SMALL, TrainRequest("parking", folder, resume, report))

    whole = train(tmp_path / "whole", resume=False)
    with pytest.raises(KilledError):
        train(tmp_path / "parts", resume=False, report=killed)
    parts = train(tmp_path / "parts", resume=True)
    assert parts.with_suffix(".onnx").read_bytes() == whole.with_suffix(".onnx").read_bytes()
    assert rows(tmp_path / "parts") == rows(tmp_path / "whole")
    assert {"gail_reward", "icm_reward"} <= set(rows(tmp_path / "whole")[0])


@pytest.mark.parametrize("algorithm", ["poca", "sac"])
def test_other_algorithms_learn_the_same_task(tmp_path, algorithm):
    settings = {"algorithm": algorithm, "karts": 2, "bco": False, "gail": False, "steps": 16}
    told: list[int] = []
    plain = SMALL.model_copy(update={**settings, "sac": SMALL.sac.model_copy(update={"round_steps": 4})})
    PARKING.train(plain, TrainRequest("parking", tmp_path, False, lambda report: told.append(report.steps)))
    assert told[-1] == 16


def test_karts_of_a_lot_share_it_and_a_curriculum_ends_in_the_task_itself():
    task = ParkingTask(karts=3, lots=2)
    assert len(set(task.held_out)) == 2
    assert len(task.held_out) == task.judged_at_once == 6
    with pytest.raises(InvalidInputError, match="multiple of 3 karts, got 4"):
        task.make_environments(4, processes=False)
    with pytest.raises(InvalidInputError, match="processes = 0"):
        task.make_environments(3, processes=True)
