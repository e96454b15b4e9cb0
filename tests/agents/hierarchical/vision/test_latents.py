"""Latents: the encoder that agents run is the one that was trained."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file, save_file

from dohyo.agents.hierarchical.vision.architecture import LATENT
from dohyo.agents.hierarchical.vision.classes import CLASSES, Seen, planes
from dohyo.agents.hierarchical.vision.latents import SHIPPED, Encoder, load_weights, onnx_model
from dohyo.agents.hierarchical.vision.network import Encoder as Network
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.rendering.labels import Label
from tests.agents.hierarchical.vision.weights import picture, untrained


@pytest.mark.parametrize("seed", range(3))
def test_it_says_what_the_network_says(seed, tmp_path):
    network = untrained(tmp_path / "e.safetensors", seed=seed)
    encoder = Encoder(tmp_path / "e.safetensors")
    with torch.no_grad():
        latent = network(torch.from_numpy(planes(picture(seed)))[None])
        told = network.tell(latent)
    got = encoder.encode(picture(seed))
    np.testing.assert_allclose(got[0], latent[0], atol=1e-5)
    np.testing.assert_allclose(got[1], told[0], atol=1e-5)
    assert (encoder.size, got[0].shape, got[0].dtype) == (12, (12,), np.float32)


def test_the_same_picture_gives_the_same_latents_and_another_others(tmp_path):
    untrained(tmp_path / "e.safetensors")
    first, second = Encoder(tmp_path / "e.safetensors"), Encoder(tmp_path / "e.safetensors")
    assert np.array_equal(first.latent(picture(1)), second.latent(picture(1)))
    assert not np.array_equal(first.latent(picture(1)), first.latent(picture(2)))


def test_planes_part_the_picture():
    every = np.arange(80 * 160, dtype=np.uint8).reshape(1, 80, 160) % len(Label)
    out = planes(every)
    assert out.shape == (CLASSES, 80, 160)
    assert (out.sum(axis=0) == 1.0).all()
    assert (out[Seen.RED] == (every[0] == Label.LIGHT_RED)).all()
    assert (out[Seen.VEHICLE] == np.isin(every[0], [Label.VEHICLE, Label.EMERGENCY])).all()


@pytest.mark.parametrize(
    "wrong",
    [
        np.zeros((1, 40, 80), np.uint8),
        np.zeros((80, 160), np.uint8),
        np.zeros((1, 80, 160), np.float32),
        np.full((1, 80, 160), len(Label), np.uint8),
    ],
)
def test_what_is_no_semantic_picture_is_refused(wrong):
    with pytest.raises(InvalidInputError, match="expected"):
        planes(wrong)


def test_a_missing_damaged_or_other_file_is_told_in_one_line(tmp_path):
    path = tmp_path / "e.safetensors"
    with pytest.raises(InvalidInputError, match="dohyo train semantic"):
        Encoder(path)
    untrained(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InvalidInputError, match="damaged"):
        Encoder(path)
    path.write_bytes(whole)
    weights = load_file(path)
    save_file({k: v for k, v in weights.items() if not k.startswith("head")}, path)
    with pytest.raises(InvalidInputError, match="another network"):
        Encoder(path)
    save_file(weights | {"mean.bias": np.full(12, np.nan, np.float16)}, path)
    with pytest.raises(InvalidInputError, match="NaN"):
        Encoder(path)
    save_file(weights | {"mean.bias": np.zeros(13, np.float16)}, path)
    with pytest.raises(InvalidInputError, match="expected"):
        Encoder(path)


def test_what_ships_is_the_thesis_size():
    weights = load_weights(SHIPPED)
    assert [weights[f"convolutions.{n}.weight"].shape for n in range(4)] == [
        (32, CLASSES, 4, 4),
        (64, 32, 4, 4),
        (128, 64, 4, 4),
        (256, 128, 4, 4),
    ]
    assert Encoder().size == LATENT
    assert onnx_model(weights).graph.output[0].type.tensor_type.shape.dim[1].dim_value == LATENT


# Of the first and second picture, as the encoder gave them when it was shipped.
SHIPPED_LATENTS = {
    0: [0.7537413239479065, 1.774321436882019, 0.8654577136039734, 1.5316609144210815],
    1: [0.6112042665481567, 2.029393196105957, 1.80608332157135, 0.6842029094696045],
}
SHIPPED_SUMS = {0: 311.85736083984375, 1: 374.65325927734375}


@pytest.mark.parametrize("seed", [0, 1])
def test_what_ships_gives_the_latents_that_it_was_shipped_with(seed):
    latent = Encoder().latent(picture(seed))
    np.testing.assert_allclose(latent[:4], SHIPPED_LATENTS[seed], rtol=1e-5)
    assert np.abs(latent).sum() == pytest.approx(SHIPPED_SUMS[seed], rel=1e-5)
    network = Network().eval()
    network.load_state_dict({name: torch.from_numpy(array) for name, array in load_weights(SHIPPED).items()})
    with torch.no_grad():
        same = network(torch.from_numpy(planes(picture(seed)))[None])[0]
    np.testing.assert_allclose(same, latent, atol=1e-4)
