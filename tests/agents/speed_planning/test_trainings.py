"""The learned parts: what is shipped answers as recorded, trainings run, and their tables."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from dohyo.agents.learning.files.report import no_report
from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.learning.networks.policy import TanhActor
from dohyo.agents.learning.runs.evaluation import Evaluation, Outcome
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.speed_planning import buffer
from dohyo.agents.speed_planning.acc import SetPointPolicy
from dohyo.agents.speed_planning.buffer import (
    LearnedBuffer,
    RuleBuffer,
    Squeeze,
    action_of_density,
    density_of_action,
)
from dohyo.agents.speed_planning.fundamental_diagram import FREEWAY
from dohyo.agents.speed_planning.study import held_out
from dohyo.agents.speed_planning.training.macroscopic import CellRoad
from dohyo.agents.trainers import trainer_named
from dohyo.sumo_networks.errors import InvalidInputError

CONFIGS = Path(buffer.__file__).with_name("configs")
RECORDED = np.load(Path(__file__).with_name("shipped.npz"))
"""Answers of the shipped policies on observations of their worlds, taken before they were loaded by `TanhActor`."""


def test_the_shipped_set_points_are_those_recorded() -> None:
    policy, seen = SetPointPolicy.shipped(), RECORDED["acc_observation"].astype(np.float64)
    assert policy.actor.act(seen) == pytest.approx(RECORDED["acc_action"], abs=1e-6)
    settings = policy.settings(seen)
    assert settings.speed == pytest.approx(RECORDED["acc_speed"], rel=1e-6)
    assert (settings.gap == RECORDED["acc_gap"]).all()
    assert len(np.unique(settings.speed)) > 10


def test_the_shipped_buffer_is_the_one_recorded() -> None:
    policy, seen = LearnedBuffer.shipped(), RECORDED["buffer_observation"].astype(np.float64)
    assert policy.actor.act(seen) == pytest.approx(RECORDED["buffer_action"], abs=1e-6)
    density = policy.density(seen[:, :-1] * FREEWAY.jam_density, Squeeze(before=4, inside=3), FREEWAY)
    assert action_of_density(density, FREEWAY) == pytest.approx(RECORDED["buffer_action"][:, 0], abs=1e-6)


def test_a_file_that_holds_no_policy_is_refused(tmp_path: Path) -> None:
    (tmp_path / "b.safetensors").write_bytes(b"no weights at all")
    for name in ("b", "none"):
        with pytest.raises(InvalidInputError, match="actor"):
            TanhActor.load(tmp_path / f"{name}.safetensors")


@pytest.mark.parametrize(("trainer", "rounds"), [("speed-buffer", 40), ("cruise-control", 15)])
def test_the_settings_of_the_shipped_weights_can_be_trained_with(trainer: str, rounds: int) -> None:
    path = CONFIGS / f"{trainer.removeprefix('speed-').replace('-', '_')}.toml"
    config = read_settings(trainer_named(trainer).config, path)
    assert config.steps == rounds * config.environments * config.ppo.horizon
    assert config.ppo.learning_rate_decay**rounds == pytest.approx(0.1, rel=0.01)
    with pytest.raises(InvalidInputError, match="processes"):
        read_settings(trainer_named(trainer).config, path, ["processes=2"])


def test_a_training_ships_a_policy_that_is_judged_beside_the_baselines(tmp_path: Path) -> None:
    settings = ["steps=180", "environments=2", "evaluate_every=180", "ppo.epochs=1", "ppo.hidden=[8]"]
    trainer = trainer_named("speed-buffer")
    config = read_settings(trainer.config, CONFIGS / "buffer.toml", [*settings, "tensorboard=false"])
    trainer.train(config, TrainRequest("speed-buffer", tmp_path / "seed-0", False, no_report))
    with (tmp_path / "seed-0" / "evaluations.csv").open() as file:
        last = list(csv.DictReader(file))[-1]
    found = held_out.judged_buffers([tmp_path / "seed-0"])
    assert list(found) == ["none", "rule", "shipped", "PPO, seed-0"]
    discharge = {name: one.measures["discharge"] for name, one in found.items()}
    assert discharge["PPO, seed-0"] == pytest.approx(float(last["discharge"]))
    assert discharge["rule"] == pytest.approx(discharge["none"], abs=0.01)
    assert found["none"].measures["requested_mps"] > found["rule"].measures["requested_mps"]


def test_tables_compare_with_both_baselines() -> None:
    text = held_out.table({"none": judged(0.6), "rule": judged(0.5), "shipped": judged(0.8)}, 100.0, {"speed": "m/s"})
    assert "| against none | against rule | m/s |" in text
    assert "| none | 3 | 60.000" in text
    assert "| shipped | 3 | 80.000" in text
    assert "| +20.000 [+20.000, +20.000] = | +30.000 [+30.000, +30.000] = | 7.00 |" in text, "three tell nothing"


def judged(mean: float) -> Evaluation:
    """Three episodes of ten steps around a mean reward."""
    return Evaluation([Outcome(seed, 10 * (mean + 0.1 * seed), 10, False, {"speed": 7.0}) for seed in (-1, 0, 1)])


def test_actions_and_densities_of_the_buffer_are_inverse() -> None:
    action = np.linspace(-1, 1, 9)
    assert action_of_density(density_of_action(action, FREEWAY), FREEWAY) == pytest.approx(action)


def test_the_rule_as_a_policy_asks_for_the_rules_density() -> None:
    diagram, profile = CellRoad().diagram, np.full((2, buffer.CELLS), 0.05)
    seen = buffer.observation(profile, Squeeze(4, 3), diagram).astype(np.float32)
    policy, rule = held_out.Rule(), RuleBuffer()
    for _ in range(3):
        action = policy(TensorDict({"observation": torch.from_numpy(seen)}, [2]))
        wanted = rule.density(profile, Squeeze(4, 3), diagram)
        assert density_of_action(action[:, 0].astype(np.float64), diagram) == pytest.approx(wanted, rel=1e-5)
    assert (wanted > diagram.critical_density).all()
