"""Training: it learns, and goes on where it stopped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from dohyo.agents.learning.files.report import Report, Reporter, no_report
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.mcts.predictors.dataset import FUTURE_STEPS, Shard
from dohyo.agents.mcts.predictors.features import SHAPES
from dohyo.agents.mcts.predictors.train import Batch, TrainConfig, displacement, load_split, loss_of, train
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.mcts.predictors.scenes import busy, sampled


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("motion")
    for split, seeds in (("train", range(12)), ("validation", range(20, 24))):
        (folder / split).mkdir()
        shard = Shard.of([sampled(busy(seed, actors=5, lanes=4)) for seed in seeds])
        (folder / split / "a.npz").write_bytes(shard.to_bytes())
    return folder


def config(data: Path, **more: object) -> TrainConfig:
    facts = {"steps": 24, "batch": 4, "warm_up_steps": 4, "validate_every": 8, "learning_rate": 3e-3} | more
    return TrainConfig(data=data, tensorboard=False, **facts)  # type: ignore[arg-type]


def trained(data: Path, out: Path, resume: bool = False, report: Reporter = no_report, **more: object) -> Path:
    return train(config(data, **more), TrainRequest("predictor", out, resume, report)).with_suffix(".safetensors")


def curve(out: Path) -> str:
    return (out / "metrics.csv").read_text()


def stopped_at(step: int) -> Reporter:
    def report(now: Report) -> None:
        if now.steps == step:
            raise KeyboardInterrupt

    return report


def test_a_training_that_was_killed_ends_with_the_same_weights_and_curve(data, tmp_path):
    whole = trained(data, tmp_path / "whole", checkpoint_s=1e-9)
    with pytest.raises(KeyboardInterrupt):
        trained(data, tmp_path / "parts", report=stopped_at(14), checkpoint_s=1e-9)
    steps: list[int] = []
    parts = trained(data, tmp_path / "parts", resume=True, report=lambda now: steps.append(now.steps))
    assert steps == list(range(14, 25))
    expected, got = load_file(whole), load_file(parts)
    assert expected.keys() == got.keys()
    assert all(torch.equal(expected[name], got[name]) for name in expected)
    assert curve(tmp_path / "whole") == curve(tmp_path / "parts")


def test_it_learns(data, tmp_path):
    """What is not constant velocity: everybody stays where it is."""
    folder = tmp_path / "still"
    for split in ("train", "validation"):
        (folder / split).mkdir(parents=True)
        shard = Shard.of([sampled(busy(seed, actors=5, lanes=4)) for seed in range(8)])
        actors, egos = shard.arrays["actors_state"], shard.arrays["ego_history"][:, -1]
        shard.arrays["actors_future"][:] = actors[:, None, :3]
        shard.arrays["ego_future"][:] = egos[:, None]
        (folder / split / "a.npz").write_bytes(shard.to_bytes())
    losses: list[float] = []
    out = tmp_path / "out"
    trained(folder, out, report=lambda now: losses.append(now.value or 0.0), steps=60)
    assert np.mean(losses[-10:]) < 0.5 * np.mean(losses[:5])


def test_a_perfect_prediction_has_no_loss(data, tmp_path):
    batch = load_split(data, "train")
    assert loss_of(batch.future, batch, config(data)).item() == pytest.approx(0.0, abs=1e-6)
    ade, fde = displacement(batch.future, batch)
    assert len(ade) == 12 * 6
    assert ade.max() == fde.max() == 0.0


def test_the_loss_by_hand(data, tmp_path):
    inputs = {name: torch.zeros(1, *shape) for name, shape in SHAPES.items()}
    future, valid = torch.zeros(1, 31, FUTURE_STEPS, 3), torch.zeros(1, 31, FUTURE_STEPS, dtype=torch.bool)
    valid[0, 0, 0] = valid[0, 1, 3] = True
    poses = torch.full_like(future, 99.0)
    poses[0, 0, 0] = torch.tensor([3.0, 0.0, 0.0])  # Huber: 2.5, of the ego: three times
    poses[0, 1, 3] = torch.tensor([0.0, 0.0, torch.pi])  # 2 m for each unit of 1 - cos: 4
    batch = Batch(inputs, future, valid)
    assert loss_of(poses, batch, config(data)).item() == pytest.approx((3 * 2.5 + 4.0) / 4.0)


def test_a_training_may_be_given_another_end_until_its_rate_falls(data, tmp_path):
    rates = [config(data, decay_steps=6).rate.at(step) for step in range(25)]
    assert rates[4:19] == [pytest.approx(3e-3)] * 15
    assert rates[19] < 3e-3
    assert rates[24] == pytest.approx(0.0, abs=1e-9)
    whole = trained(data, tmp_path / "whole", steps=14, decay_steps=6)
    with pytest.raises(KeyboardInterrupt):
        trained(data, tmp_path / "parts", report=stopped_at(9), decay_steps=6, checkpoint_s=1e-9)
    parts = trained(data, tmp_path / "parts", resume=True, steps=14, decay_steps=6)
    expected, got = load_file(whole), load_file(parts)
    assert all(torch.equal(expected[name], got[name]) for name in expected)
    with pytest.raises(InvalidInputError, match="steps = 14, not 15"):
        trained(data, tmp_path / "parts", resume=True, steps=15, decay_steps=6)


def test_a_finished_training_is_not_overwritten_and_another_not_resumed(data, tmp_path):
    trained(data, tmp_path, steps=2)
    with pytest.raises(InvalidInputError, match="--resume"):
        trained(data, tmp_path, steps=2)
    with pytest.raises(InvalidInputError, match="seed = 0, not 1"):
        trained(data, tmp_path, resume=True, steps=2, seed=1)
    with pytest.raises(InvalidInputError, match="no run"):
        trained(data, tmp_path / "other", resume=True, steps=2)
