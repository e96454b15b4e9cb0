"""The trainer of gymnasium environments: every algorithm, killed and resumed, and what it refuses."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from pydantic import ValidationError

from dohyo.agents.learning.files.report import no_report
from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.learning.gymnasium.task import GYMNASIUM, GymnasiumConfig, GymnasiumTask
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.learning.killed import killed_and_resumed

POINT, DIAL = "tests.agents.learning.problems:Point-v0", "tests.agents.learning.problems:Dial-v0"
PICTURE = "tests.agents.learning.problems:Picture-v0"
SHORT = ("steps=400", "evaluate_every=200", "checkpoint_every=100", "episodes=2", "tensorboard=false")
ALGORITHMS = {
    "sac": (POINT, "sac.round_steps=50", "sac.hidden=[32]", "sac.replay={capacity=400, steps=3, priority=0.6}"),
    "ddpg": (POINT, "ddpg.round_steps=50", "ddpg.hidden=[32]", "ddpg.replay.capacity=300"),
    "iqn": (DIAL, "iqn.round_steps=50", "iqn.target_every=20", "iqn.replay.capacity=300"),
    "ppo": (DIAL, "ppo.horizon=50"),
}


def settings_of(algorithm: str) -> list[str]:
    env, *own = ALGORITHMS[algorithm]
    return [f"env={env}", f"algorithm={algorithm}", *SHORT, *own]


def train(settings: Sequence[str], out: Path) -> None:
    GYMNASIUM.train(read_settings(GymnasiumConfig, None, settings), TrainRequest("gymnasium", out, False, no_report))


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_killed_run_ends_bit_equal_to_one_that_was_not(algorithm: str, tmp_path: Path) -> None:
    whole = killed_and_resumed("gymnasium", settings_of(algorithm), tmp_path)
    assert (whole / "replay").exists() == (algorithm != "ppo")


def test_it_trains_judges_and_exports(tmp_path: Path) -> None:
    train([*settings_of("sac"), "steps=100", "environments=2"], tmp_path / "run")
    with (tmp_path / "run" / "evaluations.csv").open() as file:
        assert [row["episodes"] for row in csv.DictReader(file)] == ["2", "2"]
    session = onnxruntime.InferenceSession(tmp_path / "run" / "policy.onnx")
    (action,) = session.run(None, {"observation": np.ones((3, 2), np.float32)})
    assert action.shape == (3, 1)
    assert (np.abs(action) <= 0.25).all()


@pytest.mark.parametrize("env", ["Blackjack-v1", "tests.agents.learning.foreign:Cabinet-v0"])
def test_environments_of_others_are_learned_from(env: str, tmp_path: Path) -> None:
    train([f"env={env}", "algorithm=ppo", *SHORT, "steps=100", "ppo.horizon=50", "processes=2"], tmp_path / "run")
    assert (tmp_path / "run" / "policy.onnx").exists()


def test_an_environment_of_dohyo_is_judged_beside_its_training(tmp_path: Path) -> None:
    settings = ["env=dohyo/Quickstart-v0", "algorithm=ppo", *SHORT, "steps=24", "longest=8"]
    train([*settings, "evaluate_every=12", "ppo.horizon=12"], tmp_path / "run")  # the evaluation is amid an episode
    with (tmp_path / "run" / "evaluations.csv").open() as file:
        assert [row["steps"] for row in csv.DictReader(file)] == ["0", "12", "24"]
    with (tmp_path / "run" / "metrics.csv").open() as file:
        assert [row["episodes"] for row in csv.DictReader(file)] == ["1", "3"]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["env=Nowhere-v0"], "environment 'Nowhere-v0'"),
        ([f"env={PICTURE}", "algorithm=ppo"], "expected an encoder for observation"),
        ([f"env={PICTURE}", "algorithm=iqn"], "expected an encoder for observation 'observation'"),
        ([f"env={DIAL}", "algorithm=ppo", "ppo.normalised=true"], "expected normalised = false"),
        ([f"env={DIAL}", "algorithm=sac"], "Sac: expected actions in a Box"),
        ([f"env={POINT}", "algorithm=iqn"], "Iqn: expected actions in a Discrete"),
        (["env=dohyo/Quickstart-v0", "environments=2"], "expected processes of at least 1 for environments = 2, got 0"),
    ],
)
def test_what_it_cannot_learn_is_refused(settings: list[str], message: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=message):
        train([*settings, *SHORT], tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_an_environment_without_a_limit_of_steps_is_given_one() -> None:
    assert not GymnasiumTask("CliffWalking-v1").ends
    task = GymnasiumTask("CliffWalking-v1", longest=7)
    assert task.ends
    env = task.make_env(0)
    env.reset(seed=0)
    assert [env.step(0)[3] for _ in range(7)] == [False] * 6 + [True]


@pytest.mark.parametrize("settings", [{"processes": -1}, {"processes": 65}, {"longest": -1}])
def test_settings_beyond_their_bounds_are_refused(settings: dict[str, int]) -> None:
    with pytest.raises(ValidationError):
        GymnasiumConfig.model_validate(settings)
