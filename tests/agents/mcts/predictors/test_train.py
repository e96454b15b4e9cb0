"""Training: it learns, and goes on where it stopped."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from dohyo.agents.mcts.predictors.dataset import FUTURE_STEPS, Shard
from dohyo.agents.mcts.predictors.features import SHAPES
from dohyo.agents.mcts.predictors.train import (
    Batch,
    TrainConfig,
    batch_indices,
    displacement,
    learning_rate,
    load_config,
    load_split,
    loss_of,
    train,
)
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


def config(data: Path, out: Path, **more: object) -> TrainConfig:
    facts = {"steps": 24, "batch": 4, "warm_up_steps": 4, "validate_every": 8, "learning_rate": 3e-3} | more
    return TrainConfig(data=data, out=out, **facts)  # type: ignore[arg-type]


def curve(out: Path) -> list[list[str]]:
    return [row[:-1] for row in csv.reader((out / "log.csv").read_text().splitlines())]  # without wall-clock time


def stopped_at(step: int):
    def progress(now: int, loss: float) -> None:
        if now == step:
            raise KeyboardInterrupt

    return progress


def test_a_training_that_was_killed_ends_with_the_same_weights_and_curve(data, tmp_path):
    whole = train(config(data, tmp_path / "whole", checkpoint_s=1e-9))
    with pytest.raises(KeyboardInterrupt):
        train(config(data, tmp_path / "parts", checkpoint_s=1e-9), progress=stopped_at(14))
    steps: list[int] = []
    parts = train(config(data, tmp_path / "parts"), resume=True, progress=lambda step, loss: steps.append(step))
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
    train(config(folder, out, steps=60), progress=lambda step, loss: losses.append(loss))
    assert np.mean(losses[-10:]) < 0.5 * np.mean(losses[:5])


def test_a_perfect_prediction_has_no_loss(data, tmp_path):
    batch = load_split(data, "train")
    assert loss_of(batch.future, batch, config(data, tmp_path)).item() == pytest.approx(0.0, abs=1e-6)
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
    assert loss_of(poses, batch, config(data, tmp_path)).item() == pytest.approx((3 * 2.5 + 4.0) / 4.0)


def test_every_epoch_shows_every_sample_once(data, tmp_path):
    settings = config(data, tmp_path)
    epochs = [torch.cat([batch_indices(step, 12, settings) for step in range(3 * e, 3 * e + 3)]) for e in (0, 1)]
    assert all(sorted(epoch.tolist()) == list(range(12)) for epoch in epochs)
    assert epochs[0].tolist() != epochs[1].tolist()


def test_the_learning_rate_rises_and_falls(data, tmp_path):
    settings = config(data, tmp_path)
    rates = [learning_rate(step, settings) for step in range(25)]
    assert max(rates) == pytest.approx(3e-3)
    assert rates[0] == pytest.approx(3e-3 / 4)
    assert rates[24] == pytest.approx(0.0, abs=1e-9)


def test_a_training_may_be_given_another_end_until_its_rate_falls(data, tmp_path):
    settings = config(data, tmp_path, decay_steps=6)
    rates = [learning_rate(step, settings) for step in range(25)]
    assert rates[4:19] == [pytest.approx(3e-3)] * 15
    assert rates[19] < 3e-3
    assert rates[24] == pytest.approx(0.0, abs=1e-9)
    whole = train(config(data, tmp_path / "whole", steps=14, decay_steps=6))
    with pytest.raises(KeyboardInterrupt):
        train(config(data, tmp_path / "parts", decay_steps=6, checkpoint_s=1e-9), progress=stopped_at(9))
    parts = train(config(data, tmp_path / "parts", steps=14, decay_steps=6), resume=True)
    expected, got = load_file(whole), load_file(parts)
    assert all(torch.equal(expected[name], got[name]) for name in expected)
    with pytest.raises(InvalidInputError, match="another configuration"):
        train(config(data, tmp_path / "parts", steps=15, decay_steps=6), resume=True)


def test_a_finished_training_is_not_overwritten_and_another_not_resumed(data, tmp_path):
    train(config(data, tmp_path, steps=2))
    with pytest.raises(InvalidInputError, match="--resume"):
        train(config(data, tmp_path, steps=2))
    with pytest.raises(InvalidInputError, match="another configuration"):
        train(config(data, tmp_path, steps=2, seed=1), resume=True)
    content = (tmp_path / "checkpoint.safetensors").read_bytes()
    (tmp_path / "checkpoint.safetensors").write_bytes(content[:-7])
    with pytest.raises(InvalidInputError, match="damaged"):
        train(config(data, tmp_path, steps=2), resume=True)
    with pytest.raises(InvalidInputError, match="no checkpoint"):
        train(config(data, tmp_path / "other", steps=2), resume=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [("steps = ", "no TOML"), ('data = "a"\nout = "b"\nsteps = 0', "steps"), ('data = "a"\nout = "b"\nx = 1', "x")],
)
def test_a_wrong_configuration_is_told_in_one_line(text, message, tmp_path):
    (tmp_path / "c.toml").write_text(text)
    with pytest.raises(InvalidInputError, match=message) as raised:
        load_config(tmp_path / "c.toml")
    assert "\n" not in str(raised.value)
    with pytest.raises(InvalidInputError, match="cannot read"):
        load_config(tmp_path / "none.toml")
