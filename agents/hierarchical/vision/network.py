"""The network: a variational autoencoder of semantic pictures, with heads that predict distances and the light.

Source: Albilani 2023, section 6.2.1 and table 6.1: convolutions of 4 x 4 with stride 2 and 32, 64, 128, 256 filters,
ReLU, two layers for mean and log-variance, z of 400. The decoder is its mirror. The heads above the mean, for
distances and the light, are ours.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from dohyo.agents.hierarchical.vision.architecture import HEAD, LATENT, STACK, TOLD
from dohyo.agents.perception.vae import Vae, VaeEncoder


class Encoder(VaeEncoder):
    """From pictures to latents, and predictions from these."""

    def __init__(self, latent: int = LATENT) -> None:
        super().__init__(STACK, latent)
        self.head = nn.Linear(latent, HEAD)
        self.told = nn.Linear(HEAD, TOLD)

    def tell(self, latent: Tensor) -> Tensor:
        """(B, 6) from (B, 400): distances to impact and to the next event [50 m], logits of the signal."""
        out: Tensor = self.told(torch.relu(self.head(latent)))
        return out


class Autoencoder(Vae):
    """The variational autoencoder around `Encoder`."""

    encoder: Encoder

    def __init__(self, latent: int = LATENT) -> None:
        super().__init__(Encoder(latent))
