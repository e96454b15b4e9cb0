"""Latent: what the actor and the critics of RLAD and RLfOLD read, h = [i, v, w] of picture, measurements and waypoints.

Source: Coelho 2024, section 3.3: 256 numbers of the picture, 16 of the measurements, 32 of the waypoints. The twin's
exact state has 64.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final, Literal

from gymnasium.spaces import Box, Dict
from pydantic import Field
from torch import Tensor, cat, nn

from dohyo.agents.endless_driving.observation import MEASUREMENTS, PICTURE, POINTS, STATE, WAYPOINTS
from dohyo.agents.learning.runs.config import Positive
from dohyo.agents.perception.encoders.rlad import RladEncoder, initialise
from dohyo.agents.perception.encoders.waypoints import WayConv1D
from dohyo.sumo_networks.config import Config

SLIM: Final = ((24, 4), (32, 2), (48, 1))
"""Channels and stride of each convolution at 64 x 64: 0.33 million parameters, and half the time of `rlad.SMALL`."""
WAYPOINT_FEATURES, MEASUREMENT_FEATURES = 32, 16
STATE_FEATURES, STATE_HIDDEN = 64, 128


class LatentConfig(Config):
    """Settings of the encoders: the table [latent].

    Attributes:
        layers: Channels and stride of each convolution, of which there is at least one; None: `SLIM` at 64 x 64, the
            thesis's at 256 x 256.
        local_mixing: Whether A-LIX follows every convolution.
        scaled_mixing: Whether A-LIX shifts small maps by the same share of their side as its source, not by as many
            pixels: 2.5 are half of a map of 5 x 5.
        waypoints: WayConv1D, or the plain layers that it replaces.
    """

    layers: Annotated[tuple[tuple[Positive, Positive], ...], Field(min_length=1)] | None = None
    local_mixing: bool = True
    scaled_mixing: bool = False
    waypoints: Literal["convolution", "plain"] = "convolution"


class Latent(nn.Module):
    """Observations by name -> (B, F) features in [-1, 1].

    Attributes:
        seen: Encoder of the picture, or of the state.
        seen_features: Its numbers, which come first.
        features: All numbers, F.
    """

    def __init__(self, space: Dict, config: LatentConfig) -> None:
        """Draws weights from torch's generator.

        Args:
            space: Of one observation, with a picture or a state.
            config: Settings.
        """
        super().__init__()
        self._name = PICTURE if PICTURE in space.spaces else STATE
        self.seen: nn.Module
        box, measured = space[self._name], space[MEASUREMENTS]
        assert isinstance(box, Box)
        assert isinstance(measured, Box)
        if self._name == PICTURE:
            self.seen = picture_encoder(box, config)
            self.seen_features = self.seen.features
        else:
            self.seen = layers(box.shape[0], STATE_HIDDEN, STATE_FEATURES)
            self.seen_features = STATE_FEATURES
        self.measured = layers(measured.shape[0], 8, MEASUREMENT_FEATURES)
        convolved = config.waypoints == "convolution"
        self.ahead = _Points(WAYPOINT_FEATURES) if convolved else layers(2 * POINTS, 20, WAYPOINT_FEATURES)
        self.features = self.seen_features + MEASUREMENT_FEATURES + WAYPOINT_FEATURES

    def forward(self, observation: Mapping[str, Tensor]) -> Tensor:
        """See the class."""
        measured, ahead = self.measured(observation[MEASUREMENTS]), self.ahead(observation[WAYPOINTS])
        return cat([self.seen(observation[self._name]), measured, ahead], dim=-1)

    def of_seen(self, features: Tensor) -> Tensor:
        """(B, F) -> the numbers that come from the picture or the state alone."""
        return features[:, : self.seen_features]


def picture_encoder(box: Box, config: LatentConfig) -> RladEncoder:
    """RLAD's encoder for pictures of a space."""
    channels, height, width = box.shape
    small = SLIM if min(height, width) < 128 else None
    mixed, scaled = config.local_mixing, config.scaled_mixing
    return RladEncoder((channels, height, width), layers=config.layers or small, mixed=mixed, scaled=scaled)


def layers(inputs: int, hidden: int, features: int) -> nn.Sequential:
    """Two linear layers, of which the last is normalised and squashed."""
    made = nn.Sequential(
        nn.Linear(inputs, hidden), nn.ReLU(), nn.Linear(hidden, features), nn.LayerNorm(features), nn.Tanh()
    )
    made.apply(initialise)
    return made


class _Points(nn.Module):
    """WayConv1D of points as one vector."""

    def __init__(self, features: int) -> None:
        super().__init__()
        self.convolution = WayConv1D(POINTS, features)

    def forward(self, points: Tensor) -> Tensor:
        found: Tensor = self.convolution(points.reshape(-1, POINTS, 2))
        return found
