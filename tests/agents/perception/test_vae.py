"""VAE: sizes, both terms of the loss by hand, and that it learns."""

from __future__ import annotations

import pytest
import torch
from torch.distributions import Normal, kl_divergence

from dohyo.agents.perception.convolutions import Convolutions, convolved
from dohyo.agents.perception.vae import Decoder, Vae, VaeEncoder, divergence, vae_loss
from dohyo.sumo_networks.errors import InvalidInputError


@pytest.mark.parametrize(
    "stack",
    [
        Convolutions(3, 64, 64),
        Convolutions(3, 84, 84),
        Convolutions(9, 50, 70, filters=(8, 16), kernel=3, stride=2),
        Convolutions(1, 33, 40, filters=(4, 4, 4), kernel=5, stride=1),
    ],
)
def test_the_decoder_mirrors_the_encoder(stack):
    vae, pictures = Vae(VaeEncoder(stack, 6)), torch.rand(2, stack.channels, stack.height, stack.width)
    logits, mean, log_variance = vae(pictures)
    assert logits.shape == pictures.shape
    assert mean.shape == log_variance.shape == (2, 6)
    torch.testing.assert_close(vae.encoder(pictures), mean)
    assert vae.encoder.features == 6
    assert stack.outputs == vae.encoder.mean.in_features


def test_sizes_by_hand():
    assert Convolutions(3, 64, 64).sizes == [(64, 64), (31, 31), (14, 14), (6, 6), (2, 2)]
    assert convolved(256, 3, 2) == 127
    with pytest.raises(InvalidInputError, match="at least 4 pixels before a convolution, got 2"):
        Decoder(Convolutions(3, 16, 30), 4)


def test_the_divergence_is_that_of_torch():
    mean, log_variance = torch.randn(5, 4), torch.randn(5, 4)
    expected = kl_divergence(Normal(mean, (0.5 * log_variance).exp()), Normal(0.0, 1.0)).sum()
    torch.testing.assert_close(divergence(mean, log_variance), expected)


def test_the_loss_is_the_negative_bound():
    vae, pictures = Vae(VaeEncoder(Convolutions(3, 32, 32, filters=(8, 8)), 4)), torch.rand(3, 3, 32, 32)
    parts = vae_loss(vae, pictures, beta=2.0, noise=False)
    logits, mean, log_variance = vae(pictures, noise=False)
    log_likelihood = pictures * torch.log(logits.sigmoid()) + (1 - pictures) * torch.log(1 - logits.sigmoid())
    assert parts["reconstruction"].item() == pytest.approx(-log_likelihood.sum().item() / 3, rel=1e-5)
    assert parts["divergence"].item() == pytest.approx(divergence(mean, log_variance).item() / 3, rel=1e-5)
    assert parts["loss"].item() == pytest.approx((parts["reconstruction"] + 2 * parts["divergence"]).item(), rel=1e-6)


def test_latents_are_drawn_around_their_means():
    vae, pictures = Vae(VaeEncoder(Convolutions(3, 32, 32, filters=(8, 8)), 4)), torch.rand(1, 3, 32, 32)
    assert not torch.equal(vae(pictures)[0], vae(pictures)[0])
    assert torch.equal(vae(pictures, noise=False)[0], vae.decode(vae.encode(pictures)[0]))


def test_it_learns_where_a_square_is():
    pictures = torch.zeros(64, 1, 16, 16, dtype=torch.uint8)
    for number in range(64):
        top, left = number // 8, number % 8
        pictures[number, 0, top : top + 8, left : left + 8] = 255
    vae = Vae(VaeEncoder(Convolutions(1, 16, 16, filters=(16, 32)), 8))
    optimiser = torch.optim.Adam(vae.parameters(), lr=5e-3)
    first = vae_loss(vae, pictures, beta=0.1)["loss"].item()
    for _ in range(120):
        optimiser.zero_grad()
        parts = vae_loss(vae, pictures, beta=0.1)
        parts["loss"].backward()
        optimiser.step()
    assert parts["loss"].item() < 0.4 * first
    with torch.no_grad():
        rebuilt = vae.decode(vae.encoder(pictures)) > 0
    assert (rebuilt == (pictures > 0)).float().mean() > 0.95
