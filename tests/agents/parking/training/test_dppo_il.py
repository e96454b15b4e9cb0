"""The trainer of parking: resumption to the bit, its parts, and clear errors."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from dohyo.agents.learning.experience.demonstrations import record_demonstrations
from dohyo.agents.learning.files.report import no_report
from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.parking.training.dppo_il import PARKING, ParkingConfig, demonstrated
from dohyo.agents.parking.training.task import ParkingTask
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.learning.killed import killed_and_resumed
from tests.agents.learning.problems import Lock

SMALL = (
    "environments=4", "lots=2", "steps=64", "evaluate_every=32", "checkpoint_every=16", "device=cpu",
    "tensorboard=false", "scene=simple", "reward=simple", "ppo.horizon=4", "ppo.hidden=[8]",
    "ppo.batch=8", "sac.round_steps=4", "sac.hidden=[8]", "sac.batch=8", "sac.learning_starts=8",
    "sac.updates_per_step=1", "sac.replay.capacity=40",
)  # fmt: skip
IMITATING = (
    "curiosity=true", "bco=true", "gail=true", "demonstrations.episodes=2",
    "cloning.inverse.epochs=1", "cloning.passes=1",
)  # fmt: skip


def columns(folder: Path) -> set[str]:
    return set(next(csv.reader((folder / "metrics.csv").open())))


def test_dppo_il_that_is_killed_ends_bit_equal_to_one_that_is_not(tmp_path):
    whole = killed_and_resumed("parking", [*SMALL, *IMITATING], tmp_path)
    assert {"gail_reward", "icm_reward"} <= columns(whole)


@pytest.mark.parametrize(
    ("algorithm", "more", "column"), [("poca", ("curiosity=true",), "icm_reward"), ("sac", (), "loss_critic")]
)
def test_so_do_other_algorithms_on_the_same_task(tmp_path, algorithm, more, column):
    whole = killed_and_resumed("parking", [*SMALL, f"algorithm={algorithm}", "karts=2", *more], tmp_path)
    assert column in columns(whole)


@pytest.mark.parametrize(
    ("parts", "got"),
    [(("gail=true",), "gail = true"), (("curiosity=true", "bco=true"), "bco = true, curiosity = true")],
)
def test_parts_of_dppo_il_are_refused_with_sac_and_leave_no_run(tmp_path, parts, got):
    settings = read_settings(ParkingConfig, None, [*SMALL, "algorithm=sac", *parts])
    with pytest.raises(InvalidInputError, match=f"= false with SAC, which has no such parts, got {got}$"):
        PARKING.train(settings, TrainRequest("parking", tmp_path / "run", False, no_report))
    assert not (tmp_path / "run").exists()


def test_a_negative_seed_of_demonstrations_is_refused():
    with pytest.raises(InvalidInputError, match=r"demonstrations.seed: .* 0, got -5"):
        read_settings(ParkingConfig, None, [*SMALL, "bco=true", "demonstrations.seed=-5"])


def test_karts_of_a_lot_share_it_and_a_curriculum_ends_in_the_task_itself():
    task = ParkingTask(karts=3, lots=2)
    assert len(set(task.held_out)) == 2
    assert len(task.held_out) == task.judged_at_once == 6
    with pytest.raises(InvalidInputError, match="multiple of 3 karts, got 4"):
        task.make_environments(4, processes=False)
    with pytest.raises(InvalidInputError, match="processes = 0"):
        task.make_environments(3, processes=True)


def test_demonstrations_of_other_spaces_are_refused(tmp_path):
    record_demonstrations(Lock(), tmp_path / "demonstrations", 1, expert="reads the dials")
    with pytest.raises(InvalidInputError, match=r"000000\.safetensors': expected column 'observation.observation'"):
        demonstrated(ParkingConfig(scene="simple", reward="simple"), tmp_path)
