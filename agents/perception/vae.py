"""Variational autoencoder of pictures: encoder, decoder, and both terms of its loss.

    vae = Vae(VaeEncoder(Convolutions(3, 64, 64), latent=64))
    vae_loss(vae, pictures, beta=1.0)["loss"].backward()
    vae.encoder(pictures)                                # (B, 64) what a policy reads

Source: Kingma and Welling 2014; the weight beta of the divergence is Higgins et al. 2017.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from dohyo.agents.perception.convolutions import Convolutions
from dohyo.agents.perception.encoders.base import Encoder, as_float


class VaeEncoder(Encoder):
    """From pictures to the means of their latents: the part that is shipped.

    Attributes:
        stack: Pictures and convolutions.
    """

    def __init__(self, stack: Convolutions, latent: int) -> None:
        """Draws weights from torch's generator.

        Args:
            stack: Pictures and convolutions.
            latent: Length of the latent vector, Z, which is that of the features.
        """
        super().__init__((stack.channels, stack.height, stack.width), latent)
        self.stack = stack
        before = (stack.channels, *stack.filters[:-1])
        self.convolutions = nn.ModuleList(
            nn.Conv2d(a, b, stack.kernel, stack.stride) for a, b in zip(before, stack.filters, strict=True)
        )
        self.mean = nn.Linear(stack.outputs, latent)

    def convolved(self, pictures: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, F) output of the last convolution."""
        for convolution in self.convolutions:
            pictures = torch.relu(convolution(pictures))
        return pictures.flatten(1)

    def encode(self, pictures: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, Z) means of the latents."""
        mean: Tensor = self.mean(self.convolved(pictures))
        return mean


class Decoder(nn.Module):
    """From latents to pictures: the mirror of a stack of convolutions."""

    def __init__(self, stack: Convolutions, latent: int) -> None:
        super().__init__()
        self.shape = (stack.filters[-1], *stack.sizes[-1])
        self.widen = nn.Linear(latent, stack.outputs)
        after = (*stack.filters[-2::-1], stack.channels)
        self.deconvolutions = nn.ModuleList(
            nn.ConvTranspose2d(a, b, stack.kernel, stack.stride, output_padding=more)
            for a, b, more in zip(stack.filters[::-1], after, _output_paddings(stack), strict=True)
        )

    def forward(self, latent: Tensor) -> Tensor:
        """(B, Z) -> (B, C, H, W) logits of each pixel."""
        out = torch.relu(self.widen(latent)).reshape(-1, *self.shape)
        for number, deconvolution in enumerate(self.deconvolutions):
            out = deconvolution(out)
            if number < len(self.deconvolutions) - 1:
                out = torch.relu(out)
        return out


class Vae(nn.Module):
    """Encoder with decoder, which is needed only for training and figures."""

    def __init__(self, encoder: VaeEncoder) -> None:
        super().__init__()
        self.encoder: VaeEncoder = encoder
        self.log_variance = nn.Linear(encoder.stack.outputs, encoder.features)
        self.decoder = Decoder(encoder.stack, encoder.features)

    def encode(self, pictures: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log-variance of the latents, each (B, Z)."""
        convolved = self.encoder.convolved(pictures)
        return self.encoder.mean(convolved), self.log_variance(convolved).clamp(-10.0, 10.0)

    def decode(self, latent: Tensor) -> Tensor:
        """(B, C, H, W) logits of each pixel."""
        out: Tensor = self.decoder(latent)
        return out

    def forward(self, pictures: Tensor, noise: bool = True) -> tuple[Tensor, Tensor, Tensor]:
        """Logits (B, C, H, W) of the reconstruction, mean and log-variance (B, Z) of the latents.

        Args:
            pictures: (B, C, H, W) float.
            noise: Whether the latents are drawn, from torch's generator, as in training; else they are their means.
        """
        mean, log_variance = self.encode(pictures)
        drawn = mean + torch.exp(0.5 * log_variance) * torch.randn_like(mean) if noise else mean
        return self.decode(drawn), mean, log_variance


def divergence(mean: Tensor, log_variance: Tensor) -> Tensor:
    """Kullback-Leibler divergence of the latents from the normal distribution, summed over the batch, in nats."""
    return -0.5 * (1.0 + log_variance - mean.square() - log_variance.exp()).sum()


def vae_loss(vae: Vae, pictures: Tensor, beta: float, noise: bool = True) -> dict[str, Tensor]:
    """Loss of pictures in [0, 1], per picture, in nats; with beta 1 the negative variational bound.

    Args:
        vae: The network.
        pictures: (B, C, H, W) uint8, or float in [0, 1]; a value is the probability of a Bernoulli distribution.
        beta: Weight of the divergence.
        noise: See `Vae.forward`.

    Returns:
        "loss", "reconstruction" and "divergence".
    """
    pictures = as_float(pictures)
    logits, mean, log_variance = vae(pictures, noise)
    reconstruction = binary_cross_entropy_with_logits(logits, pictures, reduction="sum") / len(pictures)
    apart = divergence(mean, log_variance) / len(pictures)
    return {"loss": reconstruction + beta * apart, "reconstruction": reconstruction, "divergence": apart}


def _output_paddings(stack: Convolutions) -> list[tuple[int, int]]:
    """Output padding of each transposed convolution, so that the sizes mirror those of the convolutions."""
    kernel, stride = stack.kernel, stack.stride
    return [
        (h1 - ((h0 - 1) * stride + kernel), w1 - ((w0 - 1) * stride + kernel))
        for (h0, w0), (h1, w1) in pairwise(stack.sizes[::-1])
    ]
