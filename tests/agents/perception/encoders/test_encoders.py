"""Encoders: sizes, parameters, and the form of the pictures that they read."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import onnxruntime
import pytest
import torch
from gymnasium.spaces import Box, Dict
from torch import Tensor

from dohyo.agents.learning.policies.export import export
from dohyo.agents.perception.encoders.base import Encoder
from dohyo.agents.perception.encoders.impala import ImpalaEncoder
from dohyo.agents.perception.encoders.registry import make_encoder
from dohyo.agents.perception.encoders.rlad import SMALL, RladEncoder, initialise
from dohyo.agents.perception.encoders.waypoints import WayConv1D
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError


def size(network: torch.nn.Module) -> int:
    return sum(parameter.numel() for parameter in network.parameters())


@pytest.mark.parametrize(
    ("encoder", "shape", "parameters"),
    [
        (RladEncoder, (9, 256, 256), 634_625),  # RLAD: 3 frames; table 3.1, and one strength of A-LIX
        (RladEncoder, (6, 256, 256), 633_761),  # RLfOLD: 2 frames, "approximately 0.65M"
        (RladEncoder, (9, 84, 84), 514_593),
        (RladEncoder, (9, 64, 64), 252_449),
        (ImpalaEncoder, (3, 72, 96), 982_592),  # the pictures of the paper
        (ImpalaEncoder, (9, 64, 64), 623_008),
    ],
)
def test_parameters(encoder, shape, parameters):
    assert size(encoder(shape)) == parameters


def test_the_parameters_of_rlad_by_table_3_1():
    convolutions = [(9, 32), (32, 32), (32, 32), (32, 64), *[(64, 64)] * 5]
    expected = sum(9 * a * b + b for a, b in convolutions) + 1600 * 256 + 256 + 2 * 256
    assert size(RladEncoder((9, 256, 256))) == expected + 1


@pytest.mark.parametrize("name", ["impala", "rlad"])
@pytest.mark.parametrize("shape", [(9, 64, 64), (3, 84, 84), (3, 48, 96), (3, 224, 224)])
def test_any_shape_of_pictures_gives_features(name, shape):
    encoder = make_encoder(name, shape).eval()
    with torch.no_grad():
        features = encoder(torch.rand(2, *shape))
    assert features.shape == (2, encoder.features) == (2, 256)
    assert features.std() > 0.01


@pytest.mark.parametrize("name", ["impala", "rlad"])
def test_bytes_and_floats_are_the_same_picture(name):
    encoder = make_encoder(name, (3, 64, 64)).eval()
    pictures = torch.randint(0, 256, (4, 3, 64, 64), dtype=torch.uint8)
    with torch.no_grad():
        torch.testing.assert_close(encoder(pictures), encoder(pictures.float() / 255.0))
        torch.testing.assert_close(encoder(pictures.view(2, 2, 3, 64, 64)), encoder(pictures).view(2, 2, -1))
        torch.testing.assert_close(encoder(pictures[0]), encoder(pictures)[0])


def test_wrong_pictures_are_refused():
    encoder = RladEncoder((3, 64, 64))
    with pytest.raises(InvalidInputError, match=r"expected pictures of shape \(3, 64, 64\)"):
        encoder(torch.rand(1, 3, 60, 64))
    with pytest.raises(InvalidInputError, match=r"got torch\.int64"):
        encoder(torch.zeros(1, 3, 64, 64, dtype=torch.int64))
    with pytest.raises(InvalidInputError, match="at least 3 pixels"):
        RladEncoder((3, 20, 20))
    with pytest.raises(UnknownNameError, match="impala"):
        make_encoder("impalla", (3, 64, 64))


def test_a_delta_orthogonal_convolution_keeps_the_norm_of_a_signal():
    convolution = torch.nn.Conv2d(32, 64, 3, padding=1)
    initialise(convolution)
    signal = torch.randn(5, 32, 8, 8)
    gain = torch.linalg.vector_norm(convolution(signal)) / torch.linalg.vector_norm(signal)
    assert gain.item() == pytest.approx(2**0.5, rel=1e-5)


def test_every_weight_learns():
    for encoder in (RladEncoder((3, 64, 64)), ImpalaEncoder((3, 64, 64)), WayConv1D()):
        read = torch.rand(3, *encoder.shape) if isinstance(encoder, Encoder) else torch.rand(3, 10, 2)
        encoder(read).square().sum().backward()
        assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in encoder.parameters())


def test_small_layers_are_the_design_of_the_thesis():
    assert [stride for _, stride in SMALL] == [2, 2, 2, 1, 1]


def test_waypoints():
    encoder = WayConv1D(points=10)
    assert encoder.features == 32
    assert encoder.linear[0].in_features == 180
    assert encoder(torch.rand(2, 3, 10, 2)).shape == (2, 3, 32)
    # The convolution reads pairs of neighbours: feature 0 is that of points 0 and 1, and so on.
    points = torch.rand(1, 10, 2)
    by_hand = (
        torch.stack([(encoder.convolution.weight * points[0, k : k + 2].T).sum((1, 2)) for k in range(9)], dim=1)
        + encoder.convolution.bias[:, None]
    )
    torch.testing.assert_close(encoder.convolution(points.transpose(1, 2))[0], by_hand)


class Policy(torch.nn.Module):
    """Encoders of two observations, and a linear layer."""

    def __init__(self, picture: Encoder) -> None:
        super().__init__()
        self.picture, self.points = picture, WayConv1D()
        self.head = torch.nn.Linear(picture.features + self.points.features, 2)

    def forward(self, observation: Mapping[str, Tensor]) -> Tensor:
        seen = [self.picture(observation["picture"]), self.points(observation["points"])]
        return torch.tanh(self.head(torch.cat(seen, dim=-1)))

    def facts(self) -> dict[str, str]:
        return {}


@pytest.mark.parametrize("name", ["impala", "rlad"])
def test_a_policy_with_it_is_exported_to_onnx(name, tmp_path):
    policy = Policy(make_encoder(name, (3, 64, 64))).eval()
    space = Dict({"picture": Box(0, 255, (3, 64, 64), np.uint8), "points": Box(-1, 1, (10, 2), np.float32)})
    export(policy, space, tmp_path / "policy", {})
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx")
    for batch in (1, 5):
        seen = {
            "picture": torch.randint(0, 256, (batch, 3, 64, 64), dtype=torch.uint8),
            "points": torch.rand(batch, 10, 2),
        }
        with torch.no_grad():
            expected = policy(seen)
        (action,) = session.run(None, {name: tensor.numpy() for name, tensor in seen.items()})
        np.testing.assert_allclose(action, expected, atol=1e-5)
