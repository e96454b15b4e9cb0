"""Network: a picture from above and measurements to four waypoints.

A trunk makes feature maps of the picture. The head joins them with the measurements, and a GRU cell adds one waypoint
to the one before, with the target point as input at every step. Beside it, a head of one number tells the ego's speed
from the picture alone, which keeps the features from ignoring what moves.

Source: Coelho 2024, section 5.3, and the sizes of its code: 256 numbers of the picture, an MLP of 32 and 32 on the
measurements, 288 to 256 to 256 to 128, a cell of 128. Ours: the trunk keeps the places of its feature maps, where the
thesis tunes all of EfficientNet-B0 and reads its 1,000 logits, which we cannot afford on two cores. Few numbers
are kept of each place, and more near the ego: with all of them it knew its drives by heart. A place is 6 m wide, and a
light 2 m: the frozen trunk hardly tells its colour, nor a car that stands from one that drives. So a few convolutions,
which learn with the head, read the pixels before the ego, as far as it needs to brake at 50 km/h.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Final, Literal, TypeVar

import numpy as np
import torch
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray
from torch import Tensor, nn

from dohyo.agents.learning.policies.session import session_of
from dohyo.agents.perception.encoders.base import Encoder, as_float
from dohyo.agents.perception.encoders.efficientnet import EfficientNetLite0
from dohyo.agents.priboot.measurements import MEASUREMENTS, TARGET
from dohyo.agents.priboot.recording.dataset import WAYPOINTS
from dohyo.agents.priboot.view import HEIGHT, LAYERS, WIDTH

BLOCKS: Final = 11
"""Blocks of EfficientNet-Lite0 before the last stages, up to a stride of 16."""
CHANNELS, ROWS, COLUMNS = 112, HEIGHT // 16, WIDTH // 16
MAPS: Final = CHANNELS * ROWS * COLUMNS
SCALE: Final = 5.0
"""Spread of the frozen trunk's maps over town and city views."""
KEPT, KEPT_NEAR, PICTURE, HIDDEN = 8, 32, 256, 128
"""Numbers of each place of the maps, of each place near the ego, of the picture, and of the cell."""
NEAR_ROWS, NEAR_COLUMNS = slice(3, 8), slice(2, 6)
"""Places from 5 m behind to 27 m ahead of the ego, and 13 m to each side."""
BEFORE_ROWS, BEFORE_COLUMNS = slice(8, 120), slice(48, 80)
"""Pixels from 2 m behind to 43 m ahead of the ego's centre, and 6 m to each side."""
BEFORE: Final = (16, 32, 32)
"""Channels of the convolutions that read them."""
DROPPED: Final = 0.3
"""Share of these numbers that a training leaves out, ours: the loss on held-out drives ends above that on its own."""

PictureKind = Literal["colours", "masks"]
T = TypeVar("T", Tensor, NDArray[np.uint16])


class Trunk(Encoder):
    """(B, 3, 160, 128) colours to (B, 8960) flattened maps: EfficientNet-Lite0 with ImageNet's weights.

    It is frozen until a training lets it learn.
    """

    def __init__(self, weights: Literal["imagenet", "random"] = "imagenet") -> None:
        """Loads the weights.

        Raises:
            WeightsMissingError: Their package is not installed.
        """
        super().__init__((3, HEIGHT, WIDTH), MAPS)
        whole = EfficientNetLite0((3, HEIGHT, WIDTH), weights=weights)
        self.layers = nn.Sequential(whole.stem, *list(whole.blocks)[:BLOCKS])
        self.requires_grad_(False).eval()

    def train(self, mode: bool = True) -> Trunk:
        """Stays in evaluation: the moments of the batch normalisations are ImageNet's, also where the weights learn."""
        return super().train(False)

    def encode(self, pictures: Tensor) -> Tensor:
        """Flattened feature maps; the scale of the pixels is that of EfficientNet-Lite0."""
        maps: Tensor = self.layers((pictures * 255.0 - 127.0) / 128.0)
        return maps.flatten(1)


class MaskTrunk(Encoder):
    """(B, 14, 160, 128) masks to (B, 8960) flattened maps: convolutions that learn from scratch."""

    def __init__(self) -> None:
        super().__init__((LAYERS, HEIGHT, WIDTH), MAPS)
        self.layers = nn.Sequential(*_convolutions((LAYERS, 16, 32, 64, CHANNELS)))

    def encode(self, pictures: Tensor) -> Tensor:
        """Flattened feature maps."""
        maps: Tensor = self.layers(pictures)
        return maps.flatten(1)


class Head(nn.Module):
    """Maps, the pixels before the ego, and measurements to (B, 4, 2) waypoints [m] and (B,) speed [10 m/s]."""

    def __init__(self, layers: int) -> None:
        """Makes the layers for pictures of so many."""
        super().__init__()
        self.squeeze = nn.Sequential(nn.Conv2d(CHANNELS, KEPT, 1), nn.ReLU(), nn.Flatten())
        self.squeeze_near = nn.Sequential(nn.Conv2d(CHANNELS, KEPT_NEAR, 1), nn.ReLU(), nn.Flatten())
        self.before = nn.Sequential(*_convolutions((layers, *BEFORE)), nn.Flatten())
        numbers = KEPT * ROWS * COLUMNS + KEPT_NEAR * _length(NEAR_ROWS) * _length(NEAR_COLUMNS)
        numbers += BEFORE[-1] * _length(BEFORE_ROWS) * _length(BEFORE_COLUMNS) // 4 ** len(BEFORE)
        told = (nn.Linear(numbers, PICTURE), nn.LayerNorm(PICTURE), nn.Tanh())
        self.picture = nn.Sequential(nn.Dropout(DROPPED), *told)
        self.measured = nn.Sequential(nn.Linear(MEASUREMENTS, 32), nn.ReLU(), nn.Linear(32, 32), nn.ReLU())
        self.join = nn.Sequential(
            nn.Linear(PICTURE + 32, 256), nn.ReLU(), nn.Linear(256, 256), nn.ReLU(), nn.Linear(256, HIDDEN), nn.ReLU()
        )
        self.cell = nn.GRUCell(4, HIDDEN)
        self.step = nn.Linear(HIDDEN, 2)
        self.speed = nn.Linear(PICTURE, 1)

    def forward(self, maps: Tensor, before: Tensor, measurements: Tensor) -> tuple[Tensor, Tensor]:
        """Waypoints and speed.

        Args:
            maps: (B, 8960).
            before: (B, L, 112, 32) pixels before the ego, in [0, 1], see `before_ego`.
            measurements: (B, 11).
        """
        placed = maps.reshape(-1, CHANNELS, ROWS, COLUMNS) / SCALE
        near = placed[:, :, NEAR_ROWS, NEAR_COLUMNS]
        seen = [self.squeeze(placed), self.squeeze_near(near), self.before(2.0 * before - 1.0)]
        picture = self.picture(torch.cat(seen, dim=1))
        state = self.join(torch.cat([picture, self.measured(measurements)], dim=1))
        target, at = measurements[:, TARGET], torch.zeros_like(measurements[:, :2])
        points = []
        for _ in range(WAYPOINTS):
            state = self.cell(torch.cat([at / 10.0, target], dim=1), state)
            at = at + self.step(state)
            points.append(at)
        return torch.stack(points, dim=1), self.speed(picture)[:, 0]


def before_ego(pictures: T) -> T:
    """(..., 112, 32) what is before the ego in (..., 160, 128) pictures."""
    return pictures[..., BEFORE_ROWS, BEFORE_COLUMNS]


def _convolutions(channels: Sequence[int]) -> list[nn.Module]:
    """Convolutions that halve the picture each time."""
    layers: list[nn.Module] = []
    for before, after in pairwise(channels):
        layers += [nn.Conv2d(before, after, 3, stride=2, padding=1), nn.ReLU()]
    return layers


def _length(places: slice) -> int:
    return int(places.stop - places.start)


class Priboot(nn.Module):
    """Trunk and head as a policy for `learning/policies/export`: picture and measurements to (B, 8) waypoints [m]."""

    def __init__(self, picture: PictureKind = "colours", weights: Literal["imagenet", "random"] = "imagenet") -> None:
        super().__init__()
        self.kind = picture
        self.trunk: Encoder = Trunk(weights) if picture == "colours" else MaskTrunk()
        self.head = Head(self.trunk.shape[0])

    def forward(self, observation: Mapping[str, Tensor]) -> Tensor:
        """Waypoints of a batch, in the ego's frame."""
        picture, measurements = observation["picture"], observation["measurements"]
        before = before_ego(as_float(picture))
        waypoints: Tensor = self.head(self.trunk(picture), before, measurements)[0]
        return waypoints.flatten(1)

    def facts(self) -> Mapping[str, str]:
        """Constructor's arguments."""
        return {"picture": self.kind}

    def space(self) -> Dict:
        """Space of its observations."""
        picture = Box(0, 255, self.trunk.shape, np.uint8)
        return Dict({"picture": picture, "measurements": Box(-1e3, 1e3, (MEASUREMENTS,))})


class CompiledTrunk(Trunk):
    """The same function in ONNX Runtime, picture by picture: six times as fast on one core."""

    def __init__(self) -> None:
        super().__init__()
        buffer = io.BytesIO()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # see learning/policies/export
            torch.onnx.export(
                self.layers,
                (torch.zeros(1, *self.shape),),
                buffer,  # type: ignore[arg-type]
                input_names=["picture"],
                dynamo=False,
            )
        self._session = session_of(buffer.getvalue())

    def encode(self, pictures: Tensor) -> Tensor:
        """Flattened feature maps."""
        scaled = ((pictures * 255.0 - 127.0) / 128.0).numpy()
        maps = [self._session.run(None, {"picture": one[None]})[0] for one in scaled]
        return torch.cat([torch.from_numpy(one).flatten(1) for one in maps])
