"""SAC+AE: an autoencoder shapes the features of SAC. Source: Yarats et al. 2021.

The reconstruction moves decoder and encoder, with a penalty on the features and weight decay of the decoder, which make
the autoencoder a regularised deterministic one (RAE).
"""

from __future__ import annotations

from tensordict import TensorDictBase
from torch import Tensor, nn

from dohyo.agents.endless_driving.latent import Latent
from dohyo.agents.endless_driving.observation import PICTURE
from dohyo.agents.learning.algorithms.sac import Auxiliary
from dohyo.agents.perception.encoders.base import as_float
from dohyo.agents.perception.encoders.rlad import RladEncoder

LATENT_WEIGHT, DECODER_DECAY = 1e-6, 1e-7


class Reconstruction(Auxiliary):
    """Mean squared error of the decoded picture, and the two penalties.

    Attributes:
        decoder: Features of the picture -> the picture; its layers are the encoder's, backwards.
    """

    name = "loss_reconstruction"

    def __init__(self, latent: Latent) -> None:
        """Draws weights from torch's generator."""
        super().__init__()
        assert isinstance(latent.seen, RladEncoder)
        self._of_seen = latent.of_seen
        self.decoder = mirrored(latent.seen)

    def forward(self, batch: TensorDictBase, features: Tensor) -> Tensor:
        """See `Auxiliary`."""
        seen, picture = self._of_seen(features), as_float(batch["observation", PICTURE])
        error = nn.functional.mse_loss(self.decoder(seen), picture)
        weights = sum(parameter.square().sum() for parameter in self.decoder.parameters())
        return error + LATENT_WEIGHT * 0.5 * seen.square().sum(dim=-1).mean() + DECODER_DECAY * 0.5 * weights


def mirrored(encoder: RladEncoder) -> nn.Sequential:
    """Decoder with the encoder's convolutions transposed."""
    sides, channels = [encoder.shape[1]], [encoder.shape[0]]
    convolutions = [layer for layer in encoder.convolutions if isinstance(layer, nn.Conv2d)]
    for layer in convolutions:
        sides.append((sides[-1] - layer.kernel_size[0]) // layer.stride[0] + 1)
        channels.append(layer.out_channels)
    made: list[nn.Module] = [nn.Linear(encoder.features, channels[-1] * sides[-1] ** 2)]
    made += [nn.Unflatten(1, (channels[-1], sides[-1], sides[-1]))]
    for number in range(len(convolutions), 0, -1):
        kernel, stride = convolutions[number - 1].kernel_size[0], convolutions[number - 1].stride[0]
        left_over = sides[number - 1] - ((sides[number] - 1) * stride + kernel)
        deconvolution = nn.ConvTranspose2d(channels[number], channels[number - 1], kernel, stride, 0, left_over)
        made += [nn.ReLU(), deconvolution]
    return nn.Sequential(*made)
