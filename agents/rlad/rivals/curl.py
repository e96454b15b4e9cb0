"""CURL: two views of a picture must have similar features. Source: Laskin et al. 2020.

The query is the view that SAC learns from, the key another view through an encoder that follows slowly (momentum); the
similarity is bilinear, and the other keys of the batch are the negatives (InfoNCE). Views are random shifts here,
crops in the source.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import partial

import torch
from tensordict import TensorDictBase
from torch import Tensor, nn

from dohyo.agents.endless_driving.latent import Latent
from dohyo.agents.endless_driving.observation import PICTURE
from dohyo.agents.learning.algorithms.off_policy import Augment
from dohyo.agents.learning.algorithms.sac import Auxiliary
from dohyo.agents.learning.networks.modules import soft_update

KEY_RATE = 0.05
"""Rate at which the key's encoder follows."""
POSITIVE = "positive"
"""Second view of the picture, in a batch."""


class Contrast(Auxiliary):
    """InfoNCE between two views.

    Attributes:
        keys: Encoder of the keys, without gradient.
        similarity: (F, F) matrix of the bilinear product.
    """

    name = "loss_contrast"

    def __init__(self, latent: Latent) -> None:
        """Copies the encoder."""
        super().__init__()
        self._queries: Callable[[], nn.Module] = partial(getattr, latent, "seen")  # as a module it would be ours, too
        self._of_seen = latent.of_seen
        self.keys = deepcopy(latent.seen).requires_grad_(False)
        self.similarity = nn.Parameter(torch.rand(latent.seen_features, latent.seen_features))

    def forward(self, batch: TensorDictBase, features: Tensor) -> Tensor:
        """See `Auxiliary`."""
        with torch.no_grad():
            keys = self.keys(batch[POSITIVE])
        logits = self._of_seen(features) @ self.similarity @ keys.T
        logits = logits - logits.amax(dim=1, keepdim=True).detach()
        return nn.functional.cross_entropy(logits, torch.arange(len(logits), device=logits.device))

    def follow(self) -> None:
        """See `Auxiliary`."""
        soft_update(self.keys, self._queries(), KEY_RATE)


def two_views(augment: Augment) -> Augment:
    """The augmentation, with a second view of each picture as "positive"."""

    def augmented(batch: TensorDictBase) -> TensorDictBase:
        first, second = augment(batch), augment(batch)
        first[POSITIVE] = second["observation", PICTURE]
        return first

    return augmented
