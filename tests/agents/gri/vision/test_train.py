"""Training of A-VIS: heads learn, the frozen model is the trained encoder, and a resumed training is the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from dohyo.agents.gri.vision import train as training
from dohyo.agents.gri.vision.evaluate import answers_of, constant_answers, judged, judged_split, true_answers
from dohyo.agents.gri.vision.frozen import FEATURES, SHAPE, FrozenEncoder
from dohyo.agents.gri.vision.moments import Moments
from dohyo.agents.gri.vision.network import ENCODING, VisualSystem
from dohyo.agents.gri.vision.train import WHOLE, TrainConfig, load_system, train
from dohyo.agents.learning.files.card import read_card
from dohyo.agents.learning.files.report import Report, Reporter, no_report
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.perception.drives import Drives
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.gri.vision.data import write_data


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_data(tmp_path_factory.mktemp("affordances"), train=64, validation=8, seen=48)


def trained(data: Path, out: Path, resume: bool = False, report: Reporter = no_report, **more: object) -> Path:
    config = TrainConfig(data=data, tensorboard=False, **{"epochs": 1, "batch": 16} | more)  # type: ignore[arg-type]
    return train(config, TrainRequest("affordances", out, resume, report))


@pytest.fixture(scope="module")
def learned(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A training that is long enough for hand-made pictures."""
    return trained(data, tmp_path_factory.mktemp("learned") / "run", epochs=25, learning_rate=3e-3, warm_up_steps=10)


def test_the_heads_learn_a_hand_made_set(data, learned):
    network, moments = load_system(learned.with_name(WHOLE)), Moments.load(data, "seen")
    (told, counts), true = answers_of(network, moments), true_answers(moments)
    constant = constant_answers(true_answers(Moments.load(data, "train")))
    found = judged(told, true, constant, np.arange(len(moments)) % 2)
    for head in ("junction", "lit", "colour"):
        assert found[head]["value"][0] > 0.9 > found[head]["constant"], head
    for head in ("distance_m", "angle_rad"):
        assert found[head]["value"][0] < 0.5 * found[head]["constant"], head
    assert np.diag(counts).sum() > 0.97 * counts.sum(), "a quarter of one picture in three is a building"


def test_an_evaluation_tells_both_kinds_of_cameras(data, learned):
    constant = constant_answers(true_answers(Moments.load(data, "train")))
    told = judged_split(load_system(learned.with_name(WHOLE)), Drives(data, "seen"), constant)
    assert (told["drives"], told["moments"]) == (2, 96)
    assert told["mounted"]["junction"]["moments"] == told["displaced"]["junction"]["moments"] == 48
    assert told["iou"]["building"] > 0.7
    assert told["iou"]["pedestrian"] is None


def test_the_frozen_model_is_the_encoder_alone_standardised_over_the_training(data, learned):
    frozen, network = FrozenEncoder(learned), load_system(learned.with_name(WHOLE))
    moments = Moments.load(data, "train")
    features = np.array([frozen.features(one.numpy()) for one in moments.pictures])
    with torch.inference_mode():
        encoded = network.encoder(moments.pictures).numpy()
    np.testing.assert_allclose(features, (encoded - encoded.mean(0)) / encoded.std(0, ddof=1), rtol=1e-2, atol=1e-3)
    assert features.shape == (128, FEATURES) == (128, ENCODING)
    sizes = sum(np.prod(one.dims) for one in onnx.load(learned).graph.initializer)
    kept = sum(one.numel() for one in network.encoder.parameters())
    assert kept <= sizes < kept + 3 * ENCODING, "neither decoder nor heads are in it"
    card = read_card(learned)
    assert (card.trainer, card.steps) == ("affordances", 25 * (128 // 16))


@pytest.mark.parametrize("encoder", ["classification", "untrained"])
def test_the_other_encoders_of_the_comparison_learn_less(data, tmp_path, encoder):
    written = trained(data, tmp_path / "run", encoder=encoder)
    assert FrozenEncoder(written).features(np.zeros(SHAPE, np.uint8)).shape == (FEATURES,)
    torch.manual_seed(0)
    drawn, found = VisualSystem().state_dict(), load_system(written.with_name(WHOLE)).state_dict()
    kept = {name.partition(".")[0] for name in drawn if torch.equal(drawn[name], found[name])}
    assert "decoder" in kept, "nothing is segmented"
    assert ("encoder" in kept) == (encoder == "untrained")


def test_a_training_that_was_stopped_goes_on_to_the_same_encoder(data, tmp_path):
    def stopped(now: Report) -> None:
        if now.steps == 10:
            raise KeyboardInterrupt

    whole = trained(data, tmp_path / "whole", checkpoint_s=1e-6)
    with pytest.raises(KeyboardInterrupt):
        trained(data, tmp_path / "stopped", report=stopped, checkpoint_s=1e-6)
    assert trained(data, tmp_path / "stopped", resume=True, checkpoint_s=1e-6).read_bytes() == whole.read_bytes()


def test_what_is_no_encoder_and_no_data_has_one_clear_error(data, tmp_path, learned):
    with pytest.raises(InvalidInputError, match="dohyo train affordances makes one"):
        FrozenEncoder(tmp_path / "nothing.onnx")
    other = Path(training.__file__).parents[2] / "priboot" / "checkpoints" / "priboot.onnx"
    with pytest.raises(InvalidInputError, match="holds another model"):
        FrozenEncoder(other)
    with pytest.raises(InvalidInputError, match="expected pictures, uint8"):
        FrozenEncoder(learned).features(np.zeros((3, 64, 64), np.uint8))
    with pytest.raises(InvalidInputError, match="found none"):
        trained(tmp_path, tmp_path / "run")
    with pytest.raises(InvalidInputError, match="is no trained encoder"):
        load_system(other)
