"""Networks and distributions of off-policy learners, against torch's and TorchRL's own."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Dict
from torch import nn
from torchrl.modules import TanhNormal

from dohyo.agents.learning.networks.distributions import squashed_gaussian
from dohyo.agents.learning.networks.modules import Critics, ObservationEncoder, frozen, soft_update
from dohyo.sumo_networks.errors import InvalidInputError

SPACE = Dict({"speed": Box(-1, 1, (2,), np.float32), "camera": Box(0, 255, (3, 4, 4), np.uint8)})


class Mean(nn.Module):
    features = 1

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        return pictures.float().mean(dim=(1, 2, 3))[:, None]


def test_observations_are_joined_in_the_order_of_their_space() -> None:
    encoder = ObservationEncoder(SPACE, {"camera": Mean()})
    seen = {"speed": torch.tensor([[1.0, 2.0]]), "camera": torch.full((1, 3, 4, 4), 9, dtype=torch.uint8)}
    assert encoder.features == 3
    assert sorted(encoder(seen)[0].tolist()) == [1.0, 2.0, 9.0]
    assert encoder(seen)[0].tolist() == [9.0, 1.0, 2.0]  # gymnasium sorts the names


def test_a_picture_without_an_encoder_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="encoder for observation 'camera'"):
        ObservationEncoder(SPACE)


def test_batched_critics_are_separate_networks() -> None:
    critics = Critics(3, 2, (8, 8), count=2)
    features, action = torch.randn(5, 3), torch.randn(5, 2)
    values = critics(features, action)
    for index in range(2):
        rows = torch.cat([features, action], dim=1)
        for layer in critics.body[::2]:
            rows = rows @ layer.weight[index] + layer.bias[index]
            rows = torch.relu(rows) if layer is not critics.body[-1] else rows
        assert torch.allclose(values[index], rows[:, 0], atol=1e-6)
    (gradient,) = torch.autograd.grad(values[0].sum(), critics.body[0].weight)
    assert gradient[0].abs().sum() > 0
    assert gradient[1].abs().sum() == 0


def test_a_frozen_module_passes_gradients_on_and_takes_none() -> None:
    layer, rows = nn.Linear(2, 1), torch.ones(1, 2, requires_grad=True)
    with frozen(layer):
        value = layer(rows)
    value.backward()
    assert rows.grad is not None
    assert layer.weight.grad is None
    assert layer.weight.requires_grad


def test_a_soft_update_moves_by_its_rate() -> None:
    target, online = nn.Linear(2, 1), nn.Linear(2, 1)
    before = target.weight.clone()
    soft_update(target, online, 0.25)
    assert torch.allclose(target.weight, 0.75 * before + 0.25 * online.weight)


def test_densities_of_squashed_gaussians_are_torchrls() -> None:
    mean, log_std = torch.randn(1000, 3), torch.randn(1000, 3).clamp(-2.0, 0.5)
    action, density = squashed_gaussian(mean, log_std)
    inside = (action.abs() < 0.99).all(dim=1)  # beyond, TorchRL's own rounds
    expected = TanhNormal(mean.double(), log_std.double().exp(), tanh_loc=False).log_prob(action.double())
    assert inside.sum() > 300
    assert torch.allclose(density[inside].double(), expected[inside], atol=2e-3)
    assert torch.isfinite(squashed_gaussian(torch.full((9, 1), 50.0), torch.zeros(9, 1))[1]).all()
