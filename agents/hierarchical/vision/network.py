"""The network: a variational autoencoder of semantic pictures, with heads that predict distances and the light.

Source: Albilani 2023, section 6.2.1 and table 6.1: convolutions of 4 x 4 with stride 2 and 32, 64, 128, 256 filters,
ReLU, two layers for mean and log-variance, z of 400. The decoder is its mirror. The heads above the mean, for
distances and the light, are ours.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn

from dohyo.agents.hierarchical.vision.architecture import FILTERS, HEAD, KERNEL, LATENT, STRIDE, TOLD, features, sizes
from dohyo.agents.hierarchical.vision.classes import CLASSES


class Encoder(nn.Module):
    """From pictures to latents, and predictions from these."""

    def __init__(self, latent: int = LATENT) -> None:
        super().__init__()
        before = (CLASSES, *FILTERS[:-1])
        self.convolutions = nn.ModuleList(nn.Conv2d(a, b, KERNEL, STRIDE) for a, b in zip(before, FILTERS, strict=True))
        self.mean = nn.Linear(features(), latent)
        self.head = nn.Linear(latent, HEAD)
        self.told = nn.Linear(HEAD, TOLD)

    def features(self, planes: Tensor) -> Tensor:
        """(B, 15, 80, 160) -> (B, 6144) output of the last convolution."""
        for convolution in self.convolutions:
            planes = torch.relu(convolution(planes))
        return planes.flatten(1)

    def tell(self, latent: Tensor) -> Tensor:
        """(B, 6) from (B, 400): distances to impact and to the next event [50 m], logits of the signal."""
        out: Tensor = self.told(torch.relu(self.head(latent)))
        return out

    def forward(self, planes: Tensor) -> tuple[Tensor, Tensor]:
        """Mean of the latents, (B, 400), and predictions, (B, 6)."""
        latent = self.mean(self.features(planes))
        return latent, self.tell(latent)


class Autoencoder(nn.Module):
    """Encoder with decoder, which is needed only for training and figures."""

    def __init__(self, latent: int = LATENT) -> None:
        super().__init__()
        self.encoder = Encoder(latent)
        self.shape = (FILTERS[-1], *sizes()[-1])
        self.log_variance, self.widen = nn.Linear(features(), latent), nn.Linear(latent, features())
        after = (*FILTERS[-2::-1], CLASSES)
        self.deconvolutions = nn.ModuleList(
            nn.ConvTranspose2d(a, b, KERNEL, STRIDE, output_padding=more)
            for a, b, more in zip(FILTERS[::-1], after, _output_paddings(), strict=True)
        )

    def encode(self, planes: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log-variance of the latents, each (B, 400)."""
        features = self.encoder.features(planes)
        return self.encoder.mean(features), self.log_variance(features).clamp(-10.0, 10.0)

    def decode(self, latent: Tensor) -> Tensor:
        """(B, 15, 80, 160) logits of each pixel's class."""
        out = torch.relu(self.widen(latent)).reshape(-1, *self.shape)
        for number, deconvolution in enumerate(self.deconvolutions):
            out = deconvolution(out)
            if number < len(self.deconvolutions) - 1:
                out = torch.relu(out)
        return out


def _output_paddings() -> list[tuple[int, int]]:
    """Output padding of each transposed convolution, so that the sizes mirror those of the convolutions."""
    return [
        (h1 - ((h0 - 1) * STRIDE + KERNEL), w1 - ((w0 - 1) * STRIDE + KERNEL))
        for (h0, w0), (h1, w1) in pairwise(sizes()[::-1])
    ]
