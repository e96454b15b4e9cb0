"""The trainer `gri`: each algorithm takes demonstrations, a killed run goes on to the bit, and errors are clear."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import pytest

from dohyo.agents.gri.experts import DemonstratedTask
from dohyo.agents.gri.training import GRI, GriRunConfig, demonstrations_of
from dohyo.agents.learning.experience.demonstrations import INDEX, record_demonstrations
from dohyo.agents.learning.files.card import read_cards, write_card
from dohyo.agents.learning.files.report import no_report
from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.learning.gymnasium.task import GYMNASIUM, GymnasiumConfig
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.learning.killed import killed_and_resumed
from tests.agents.learning.problems import Lock, Point

ENVS = {"sac": "Point-v0", "ddpg": "Point-v0", "iqn": "Dial-v0"}
SMALL = ("device=cpu", "tensorboard=false", "steps=160", "evaluate_every=80", "checkpoint_every=40", "episodes=2")
SIZES = ("hidden=[8]", "batch=8", "round_steps=20", "learning_starts=20", "replay.capacity=2000")


def settings(algorithm: str) -> tuple[str, ...]:
    sizes = (f"{algorithm}.{one}" for one in SIZES)
    return (*SMALL, *sizes, f"env=tests.agents.learning.problems:{ENVS[algorithm]}", f"algorithm={algorithm}")


@pytest.fixture(scope="module")
def experts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """An untrained policy on each environment."""
    folder = tmp_path_factory.mktemp("experts")
    for env, algorithm in (("Point-v0", "ddpg"), ("Dial-v0", "iqn")):
        config = read_settings(GymnasiumConfig, None, (*settings(algorithm), "steps=20"))
        GYMNASIUM.train(config, TrainRequest("gymnasium", folder / env, False, no_report))
    return {env: folder / env / "best.onnx" for env in ("Point-v0", "Dial-v0")}


def arguments(algorithm: str, experts: dict[str, Path]) -> tuple[str, ...]:
    return (*settings(algorithm), f"expert={experts[ENVS[algorithm]]}", "shown=3", "gri.p_demo=0.7")


@pytest.mark.parametrize("algorithm", ENVS)
def test_every_algorithm_learns_from_both_and_a_killed_run_goes_on_to_the_bit(algorithm, experts, tmp_path):
    whole = killed_and_resumed("gri", arguments(algorithm, experts), tmp_path)
    with (whole / "metrics.csv").open() as file:
        shares = [float(row["replay_demonstrated"]) for row in csv.DictReader(file)]
    assert 0.0 < shares[-1] < 1.0


def test_without_demonstrations_it_is_the_algorithm_alone(tmp_path):
    config = read_settings(GriRunConfig, None, (*settings("sac"), "gri.p_demo=0", "steps=80"))
    GRI.train(config, TrainRequest("gri", tmp_path / "gri", False, no_report))
    plain = read_settings(GymnasiumConfig, None, (*settings("sac"), "steps=80"))
    GYMNASIUM.train(plain, TrainRequest("gymnasium", tmp_path / "plain", False, no_report))
    assert (tmp_path / "gri" / "metrics.csv").read_bytes() == (tmp_path / "plain" / "metrics.csv").read_bytes()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ((), "has no expert: expected 'expert', 'demonstrations' or p_demo = 0"),
        (("expert=/nowhere.onnx",), "no policy '/nowhere.onnx'"),
        (("demonstrations=/nowhere",), "no demonstrations in '/nowhere'"),
        (("algorithm=iqn",), "expected actions in a Discrete"),
        (("env=Nothing-v0",), "environment 'Nothing-v0'"),
    ],
)
def test_it_says_what_is_missing_and_leaves_no_run(more, said, tmp_path):
    config = read_settings(GriRunConfig, None, (*settings("sac"), *more))
    with pytest.raises(InvalidInputError, match=said):
        GRI.train(config, TrainRequest("gri", tmp_path / "run", False, no_report))
    assert [path.name for path in tmp_path.rglob("*") if path.is_file() and path.name != ".lock"] == []


def test_an_expert_of_another_environment_is_refused(experts, tmp_path):
    """By its spaces, or, where they are the same, by the task on its card."""
    dial = f"expert={experts['Dial-v0']}"
    point = experts["Point-v0"]
    other = tmp_path / "other"
    shutil.copytree(point.parent, other)
    card = read_cards(other)["best"].model_copy(update={"subject": "Walker2d-v5"})
    write_card(other, "best", card)
    for expert, said in (
        (dial, "policy '.*': expected"),
        (f"expert={other / point.name}", "its card says 'Walker2d-v5'"),
    ):
        config = read_settings(GriRunConfig, None, (*settings("ddpg"), expert))
        with pytest.raises(InvalidInputError, match=said):
            GRI.train(config, TrainRequest("gri", tmp_path / "run", False, no_report))
    assert not (tmp_path / "run").exists()


def test_demonstrations_of_driving_whose_goals_are_terminal_are_refused(tmp_path):
    entry = {"file": "episodes/0", "sha256": "", "seed": 0, "length": 1, "total": 1.0, "success": True, "measures": {}}
    index = {"task": "driving-state", "expert": "its own", "seed": 0, "episodes": [{**entry, "terminated": True}]}
    (tmp_path / INDEX).write_text(json.dumps(index))
    config = read_settings(GriRunConfig, None, ("env=driving-state", f"demonstrations={tmp_path}"))
    with pytest.raises(InvalidInputError, match="recorded when a goal was a terminal state"):
        demonstrations_of(config, config.task, tmp_path)


def test_demonstrations_of_another_task_or_expert_are_refused(experts, tmp_path):
    def train(*more: str) -> None:
        config = read_settings(GriRunConfig, None, (*arguments("sac", experts), *more))
        GRI.train(config, TrainRequest("gri", tmp_path / "run", False, no_report))

    record_demonstrations(DemonstratedTask(Point()), tmp_path / "run" / "demonstrations", 2, expert="its own")
    with pytest.raises(InvalidInputError, match=r"expected demonstrations of .*Point-v0', got 'point'"):
        train()
    with pytest.raises(InvalidInputError, match=r"expected demonstrations of .*Point-v0', got 'point'"):
        train(f"demonstrations={tmp_path / 'run' / 'demonstrations'}")
    index = tmp_path / "run" / "demonstrations" / INDEX
    index.write_text(index.read_text().replace('"point"', f'"{settings("sac")[-2].partition("=")[2]}"'))
    with pytest.raises(InvalidInputError, match="expected expert and number of demonstrations"):
        train()


def test_demonstrations_of_other_spaces_are_refused_before_they_are_learned(experts, tmp_path):
    folder, name = tmp_path / "shown", settings("sac")[-2].partition("=")[2]
    record_demonstrations(DemonstratedTask(Lock()), folder, 2, expert="its own")
    (folder / INDEX).write_text((folder / INDEX).read_text().replace('"lock"', f'"{name}"'))
    config = read_settings(GriRunConfig, None, (*arguments("sac", experts), f"demonstrations={folder}"))
    with pytest.raises(InvalidInputError, match=r"000000\.safetensors'"):
        demonstrations_of(config, config.task, tmp_path)
