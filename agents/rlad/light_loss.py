"""Loss of traffic lights: what the picture's features say of the light ahead; it moves decoder and picture encoder.

Source: Coelho 2024, section 3.3.4: none, red (with yellow) or green within 18 m, cross-entropy on every batch; the
decoder's widths are those of the author's release.
"""

from __future__ import annotations

from tensordict import TensorDictBase
from torch import Tensor, nn

from dohyo.agents.endless_driving.environment import LIGHT
from dohyo.agents.endless_driving.latent import Latent
from dohyo.agents.learning.algorithms.sac import Auxiliary
from dohyo.agents.learning.networks.modules import mlp

CLASSES = 3
HIDDEN = (128, 64)


class LightLoss(Auxiliary):
    """Cross-entropy of the light's class.

    Attributes:
        decoder: Features of the picture -> logits of the classes.
    """

    name = "loss_light"

    def __init__(self, latent: Latent) -> None:
        """Draws weights from torch's generator; `latent` says which features are the picture's."""
        super().__init__()
        self._of_seen = latent.of_seen
        self.decoder = mlp((latent.seen_features, *HIDDEN, CLASSES))

    def forward(self, batch: TensorDictBase, features: Tensor) -> Tensor:
        """See `Auxiliary`."""
        classes = batch["observation", LIGHT].squeeze(-1).long()
        return nn.functional.cross_entropy(self.decoder(self._of_seen(features)), classes)
