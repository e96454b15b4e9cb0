"""Network: centreline, own motion and PDM-Closed's plan -> poses of the next 8 s.

As an offset to the plan (PDM-Hybrid) or, without the plan, as the poses themselves (PDM-Open). Source: Dauner et al.
2023: an MLP with two hidden layers of 512.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from dohyo.agents.pdm_hybrid.plans import LENGTH_UNIT, MOTION, PATH, PLAN, POSES, SIZES

WIDTH = 512


class PlanNetwork(nn.Module):
    """Inputs of `plans.SPACE` -> (B, 16, 3) x, y [m], heading [rad].

    Attributes:
        planned: Whether it sees the plan and corrects it.
    """

    def __init__(self, planned: bool = True) -> None:
        """Draws weights from torch's generator; an untrained network of a plan hardly changes it."""
        super().__init__()
        self.planned = planned
        self.seen = (MOTION, PATH, PLAN) if planned else (MOTION, PATH)
        self.layers = nn.Sequential(
            nn.Linear(sum(SIZES[name] for name in self.seen), WIDTH),
            nn.ReLU(),
            nn.Linear(WIDTH, WIDTH),
            nn.ReLU(),
            nn.Linear(WIDTH, 3 * POSES),
        )
        self.register_buffer("unit", torch.tensor([LENGTH_UNIT, LENGTH_UNIT, 1.0]), persistent=False)

    def forward(self, observation: Mapping[str, Tensor]) -> Tensor:
        """See the class."""
        offset = self.layers(torch.cat([observation[name] for name in self.seen], dim=-1))
        poses = offset + observation[PLAN] if self.planned else offset
        told: Tensor = poses.unflatten(-1, (POSES, 3)) * self.unit
        return told

    def facts(self) -> Mapping[str, str]:
        """See `Exportable`."""
        return {"planned": str(self.planned).lower()}
