"""The network: two encoders of one form; a decoder of classes behind the first, heads behind the second.

Source: Chekroun 2024, section 4.4.2.1 and figure 4.5: a fully convolutional decoder on all three pictures, several
outputs from that of the centre; both encodings are concatenated. The thesis's encoders are EfficientNet-b1; ours are
four convolutions, which a processor's core affords.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import torch
from torch import Tensor, nn

from dohyo.agents.gri.vision.cameras import CAMERAS, CENTRE, SIDE_PX
from dohyo.agents.gri.vision.labels import COLOURS
from dohyo.agents.hierarchical.vision.classes import CLASSES
from dohyo.agents.perception.encoders.base import Encoder

FILTERS: Final = (32, 64, 128, 128)
"""Of the convolutions, at 32, 16, 8 and 4 pixels."""
KERNEL, STRIDE, PADDING = 4, 2, 1
MAPS: Final = (16, 4, 4)
"""Feature maps of a picture; flattened they are its features."""
FEATURES: Final = MAPS[0] * MAPS[1] * MAPS[2]
SCALE: Final = 1 / 16
"""Deviation of a frozen feature. With 1 four encodings drown speed and command, and one of Adam's updates
moves the first layer's answers 80 times as far as with a state of 51 numbers.
"""
ENCODING: Final = (len(CAMERAS) + 1) * FEATURES
"""Length of both encodings together."""
DECODER: Final = (64, 32, 16, 16)
"""Filters of the decoder at 8, 16, 32 and 64 pixels."""


class MapEncoder(Encoder):
    """(B, 3, 64, 64) to (B, 256): convolutions that halve the sides, and one to few maps."""

    def __init__(self) -> None:
        """Draws weights from torch's generator."""
        super().__init__((3, SIDE_PX, SIDE_PX), FEATURES)
        layers: list[nn.Module] = []
        for before, after in zip((3, *FILTERS[:-1]), FILTERS, strict=True):
            layers += [nn.Conv2d(before, after, KERNEL, STRIDE, PADDING), nn.ReLU()]
        self.layers = nn.Sequential(*layers, nn.Conv2d(FILTERS[-1], MAPS[0], 1), nn.Flatten())

    def encode(self, pictures: Tensor) -> Tensor:
        """See `Encoder`."""
        features: Tensor = self.layers(pictures)
        return features


class AffordanceEncoder(MapEncoder):
    """(B, 3, 64, 64) to (B, 256): the same, and a layer that mixes the maps, from which the heads are linear."""

    def __init__(self) -> None:
        """Draws weights from torch's generator."""
        super().__init__()
        self.layers.extend([nn.ReLU(), nn.Linear(FEATURES, FEATURES), nn.ReLU()])


class VisualEncoder(nn.Module):
    """Both encoders: the part that is frozen and shipped.

    Attributes:
        scene: Reads all three pictures.
        affordances: Reads the centre's.
    """

    def __init__(self) -> None:
        super().__init__()
        self.scene, self.affordances = MapEncoder(), AffordanceEncoder()

    def forward(self, pictures: Tensor) -> Tensor:
        """(B, 3, 3, 64, 64) pictures, uint8 or float in [0, 1], to (B, 1024) both encodings."""
        return torch.cat([self.scene(pictures).flatten(1), self.affordances(pictures[:, CENTRE])], dim=1)


class Decoder(nn.Sequential):
    """(B, 256) features of a picture to (B, 15, 64, 64) logits of its classes: convolutions alone."""

    def __init__(self) -> None:
        layers: list[nn.Module] = [nn.Unflatten(1, MAPS)]
        for before, after in zip((MAPS[0], *DECODER[:-1]), DECODER, strict=True):
            layers += [nn.ConvTranspose2d(before, after, KERNEL, STRIDE, PADDING), nn.ReLU()]
        super().__init__(*layers, nn.Conv2d(DECODER[-1], CLASSES, 1))


class Predictions(NamedTuple):
    """Outputs of the heads for B pictures.

    Attributes:
        road: (B, 2) logits: straight on, junction.
        light: (B, 2) logits: none, one.
        colour: (B, 3) logits of `labels.COLOURS`.
        distance: (B,) to the light [`labels.LIGHT_M`].
        angle: (B,) to the lane, rad.
        offset: (B,) from the lane's middle, m.
    """

    road: Tensor
    light: Tensor
    colour: Tensor
    distance: Tensor
    angle: Tensor
    offset: Tensor


class Heads(nn.Module):
    """(B, 256) features to predictions."""

    def __init__(self) -> None:
        super().__init__()
        self.sizes = (2, 2, len(COLOURS), 1, 1, 1)
        self.layers = nn.Linear(FEATURES, sum(self.sizes))

    def forward(self, features: Tensor) -> Predictions:
        """See the class."""
        road, light, colour, *numbers = self.layers(features).split(self.sizes, dim=1)
        return Predictions(road, light, colour, *(number[:, 0] for number in numbers))


class VisualSystem(nn.Module):
    """The encoder with all that it is trained by.

    Attributes:
        encoder: Kept.
        decoder: Of the first encoder's pictures.
        heads: Behind the second encoder.
        scene_heads: Behind the first one, where it learns to classify and not to segment.
    """

    def __init__(self) -> None:
        """Draws weights from torch's generator."""
        super().__init__()
        self.encoder, self.decoder = VisualEncoder(), Decoder()
        self.heads, self.scene_heads = Heads(), Heads()

    def segment(self, pictures: Tensor) -> Tensor:
        """(B, 3, 64, 64) pictures of any camera to (B, 15, 64, 64) logits of the classes."""
        logits: Tensor = self.decoder(self.encoder.scene(pictures))
        return logits

    def predict(self, pictures: Tensor) -> Predictions:
        """(B, 3, 3, 64, 64) to what the second encoder's heads say of the centre."""
        return self.heads(self.encoder.affordances(pictures[:, CENTRE]))  # type: ignore[no-any-return]

    def predict_from_scene(self, pictures: Tensor) -> Predictions:
        """(B, 3, 3, 64, 64) to what the first encoder's heads say of the centre."""
        return self.scene_heads(self.encoder.scene(pictures[:, CENTRE]))  # type: ignore[no-any-return]


class Frozen(nn.Module):
    """The shipped model: both encodings, with mean 0 and deviation `SCALE` over the pictures of the training."""

    def __init__(self, encoder: VisualEncoder, mean: Tensor, deviation: Tensor) -> None:
        """Takes the encoder, and (1024,) moments of its encodings."""
        super().__init__()
        self.encoder = encoder
        self.register_buffer("mean", mean)
        self.register_buffer("factor", SCALE / deviation)

    def forward(self, pictures: Tensor) -> tuple[Tensor]:
        """(B, 3, 3, 64, 64) uint8 to (B, 1024)."""
        return ((self.encoder(pictures) - self.get_buffer("mean")) * self.get_buffer("factor"),)
