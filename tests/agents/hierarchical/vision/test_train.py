"""Training of the autoencoder: it learns, and goes on where it stopped."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from dohyo.agents.hierarchical.vision.architecture import STACK, encoder_shapes
from dohyo.agents.hierarchical.vision.classes import Seen
from dohyo.agents.hierarchical.vision.network import Autoencoder, Encoder
from dohyo.agents.hierarchical.vision.train import (
    Batch,
    TrainConfig,
    class_weights,
    load_autoencoder,
    losses_of,
    train,
)
from dohyo.agents.learning.files.report import Report, Reporter, no_report
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.hierarchical.vision.weights import pictures
from tests.forked import Python


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("semantic")
    for split, count, seed in (("train", 12, 0), ("validation", 4, 100)):
        (folder / split).mkdir()
        (folder / split / "a.npz").write_bytes(pictures(count, seed).to_bytes())
    return folder


def config(data: Path, **more: object) -> TrainConfig:
    facts = {"epochs": 3, "batch": 4, "warm_up_steps": 2, "latent": 8, "learning_rate": 3e-3} | more
    return TrainConfig(data=data, tensorboard=False, **facts)  # type: ignore[arg-type]


def trained(data: Path, out: Path, resume: bool = False, report: Reporter = no_report, **more: object) -> Path:
    return train(config(data, **more), TrainRequest("semantic", out, resume, report))


def curve(out: Path) -> str:
    return (out / "metrics.csv").read_text()


def stopped_at(step: int) -> Reporter:
    def report(now: Report) -> None:
        if now.steps == step:
            raise KeyboardInterrupt

    return report


def test_a_training_that_was_cut_off_ends_with_the_same_weights_and_curve(data, tmp_path):
    whole = trained(data, tmp_path / "whole", checkpoint_s=1e-9)
    with pytest.raises(KeyboardInterrupt):
        trained(data, tmp_path / "parts", report=stopped_at(5), checkpoint_s=1e-9)
    steps: list[int] = []
    parts = trained(data, tmp_path / "parts", resume=True, report=lambda now: steps.append(now.steps))
    assert steps == list(range(5, 10)), "the fifth came after the last checkpoint"
    expected, got = load_file(whole), load_file(parts)
    assert expected.keys() == got.keys()
    assert all(torch.equal(expected[name], got[name]) for name in expected)
    assert curve(tmp_path / "whole") == curve(tmp_path / "parts")


def test_a_killed_process_leaves_what_can_be_resumed(data, tmp_path):
    code = (
        "from pathlib import Path; from tests.agents.hierarchical.vision.test_train import trained;"
        f"trained(Path({str(data)!r}), Path({str(tmp_path)!r}), epochs=500, checkpoint_s=1e-9)"
    )
    process = Python(code)
    process.wait_for(lambda: bool(list(tmp_path.glob("checkpoint-*.pt"))))
    assert process.end(signal.SIGKILL) == -signal.SIGKILL
    steps: list[int] = []

    def first(now: Report) -> None:
        steps.append(now.steps)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        trained(data, tmp_path, resume=True, report=first, epochs=500)
    assert steps[0] >= 2


def test_it_learns_to_rebuild_and_to_tell(data, tmp_path):
    losses: list[float] = []
    more = {"epochs": 25, "beta": 0.01, "latent": 16, "distance_weight": 10.0}
    trained(data, tmp_path, report=lambda now: losses.append(now.value or 0.0), **more)
    assert np.mean(losses[-5:]) < 0.4 * losses[0]
    network = load_autoencoder(tmp_path / "autoencoder.safetensors")
    batch = Batch.of(pictures(12))
    with torch.no_grad():
        mean, _ = network.encode(batch.planes)
        right = (network.decode(mean).argmax(dim=1) == batch.classes).float().mean()
        told = network.encoder.tell(mean)[:, :2]
    assert right > 0.9
    error, blind = (told - batch.distances).abs().mean(0), (batch.distances.mean(0) - batch.distances).abs().mean(0)
    assert error[0] < 0.7 * blind[0], "the car's size says how far it is"


def test_the_parts_of_the_loss_by_hand(data, tmp_path):
    torch.manual_seed(0)
    network, batch = Autoencoder(8).eval(), Batch.of(pictures(2))
    weights = torch.ones(len(Seen))
    with torch.no_grad():
        network.encoder.mean.weight.zero_()
        network.encoder.mean.bias.fill_(2.0)
        network.log_variance.weight.zero_()
        network.log_variance.bias.zero_()
        parts = losses_of(network, batch, weights, config(data, beta=3.0), noise=False)
        logits = network.decode(torch.full((2, 8), 2.0))
    # A normal distribution of mean 2 and variance 1 is 2 nats from the standard one, in each of eight numbers.
    assert parts["divergence"].item() == pytest.approx(8 * 2.0 / (80 * 160), rel=1e-5)
    log_share = torch.log_softmax(logits, dim=1).gather(1, batch.classes.long()[:, None])
    assert parts["pixels"].item() == pytest.approx(-log_share.mean().item(), rel=1e-5)
    total = parts["pixels"] + 3.0 * parts["divergence"] + parts["distances"] + 0.1 * parts["signal"]
    assert parts["loss"].item() == pytest.approx(total.item(), rel=1e-6)


def test_rare_classes_weigh_more_and_absent_ones_nothing():
    classes = torch.zeros(1, 80, 160, dtype=torch.uint8)
    classes[0, :20] = Seen.ROAD
    classes[0, 0, :8] = Seen.RED
    weights = class_weights(classes, 0.5)
    assert weights[Seen.RED] > weights[Seen.ROAD] > weights[Seen.NONE] > 0.0
    assert weights[Seen.GREEN] == 0.0
    assert weights[classes.long()].mean().item() == pytest.approx(1.0, rel=1e-5)
    assert weights[Seen.RED] / weights[Seen.NONE] == pytest.approx((9600 / 8) ** 0.5, rel=1e-4)
    flat = class_weights(classes, 0.0)
    assert flat[[Seen.NONE, Seen.ROAD, Seen.RED]].tolist() == pytest.approx([1.0, 1.0, 1.0])


def test_the_decoder_mirrors_the_encoder():
    network = Autoencoder()
    assert STACK.sizes == [(80, 160), (39, 79), (18, 38), (8, 18), (3, 8)]
    assert {name: tuple(t.shape) for name, t in Encoder().state_dict().items()} == encoder_shapes()
    assert network.decode(torch.zeros(1, 400)).shape == (1, len(Seen), 80, 160)
    mean, log_variance = network.encode(torch.zeros(2, len(Seen), 80, 160))
    assert mean.shape == log_variance.shape == (2, 400)


def test_another_training_is_neither_overwritten_nor_resumed(data, tmp_path):
    trained(data, tmp_path, epochs=1)
    with pytest.raises(InvalidInputError, match="--resume"):
        trained(data, tmp_path, epochs=1)
    with pytest.raises(InvalidInputError, match=r"beta = 1\.0, not 0\.5"):
        trained(data, tmp_path, resume=True, epochs=1, beta=0.5)
    with pytest.raises(InvalidInputError, match="no run"):
        trained(data, tmp_path / "other", resume=True, epochs=1)
    for path in tmp_path.glob("checkpoint-*.pt"):
        path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(InvalidInputError, match="damaged"):
        trained(data, tmp_path, resume=True, epochs=1)
    (tmp_path / "autoencoder.safetensors").write_bytes(b"x")
    with pytest.raises(InvalidInputError, match="no autoencoder"):
        load_autoencoder(tmp_path / "autoencoder.safetensors")
