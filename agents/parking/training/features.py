"""Features of a kart's observation: where the spot is from the kart, where the kart is from the spot, what is near.

Every learner of parking sees these instead of the lot's coordinates, which say the same and are learned more slowly. It
is a part of the exported policies, which take the observation itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import torch
from torch import Tensor, nn

from dohyo.agents.learning.tasks.task import SINGLE
from dohyo.sumo_networks.parking.observation import PER_RAY, POSITION_SCALE_M, RADAR
from dohyo.sumo_networks.parking.radar import RANGE_M, RAYS

FAR_M: Final = 20.0
NEAR_M: Final = (1.0, 5.0)
"""Scales of positions that are bounded by tanh."""
OBSTACLE_M: Final = 3.0
"""Distance at which an obstacle's feature is 1/e of that at contact."""
_STATE: Final = 16
FEATURES: Final = _STATE + (PER_RAY + 1) * RAYS


class KartFeatures(nn.Module):
    """Observations by name -> (..., F) features.

    Attributes:
        features: Their number F.
    """

    features = FEATURES

    def forward(self, observation: Mapping[str, Tensor]) -> Tensor:
        """(..., 64) `oriented` observations -> (..., F)."""
        seen = observation[SINGLE]
        heading = math.pi * seen[..., 0]
        cos, sin = torch.cos(heading), torch.sin(heading)
        dx, dy = POSITION_SCALE_M * seen[..., 9], POSITION_SCALE_M * seen[..., 10]
        ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
        distance = torch.sqrt(ahead * ahead + left * left + 1e-6)
        along, beside = in_spot(ahead, left, seen[..., 12], seen[..., 13])
        parts = [
            ahead / FAR_M,
            left / FAR_M,
            ahead / distance,
            left / distance,
            torch.log1p(distance),
            *(torch.tanh(value / scale) for value in (along, beside) for scale in NEAR_M),
            cos * seen[..., 4] + sin * seen[..., 5],
            seen[..., 12],
            seen[..., 13],
            *(seen[..., column] for column in (16, 17, 18)),
            torch.log1p(torch.abs(beside)) * torch.sign(beside),
        ]
        rays = seen[..., RADAR:].reshape(*seen.shape[:-1], RAYS, PER_RAY)
        metres = RANGE_M * rays[..., 0]
        near, far = torch.exp(-metres / OBSTACLE_M), (metres / FAR_M).clamp(max=1.0)
        return torch.cat([torch.stack(parts, dim=-1), near, far, rays[..., 1:].flatten(-2)], dim=-1)


def in_spot(ahead: Tensor, left: Tensor, cos: Tensor, sin: Tensor) -> tuple[Tensor, Tensor]:
    """Kart in the frame of the spot: along its axis and to the left of it, m.

    Args:
        ahead: (...) spot from the kart, m.
        left: (...) likewise, to the left.
        cos: (...) cosine of the kart's heading in the frame of the spot.
        sin: (...) its sine.
    """
    return -(cos * ahead - sin * left), -(sin * ahead + cos * left)
