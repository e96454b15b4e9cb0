"""Agents of small untrained policies, and the modules that they are exported from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from gymnasium.spaces import Box, Dict
from torch import Tensor, nn

from dohyo.agents.learning.policies.policy_agent import ActionDecoder, AsControl, Choices, PolicyAgent, SensorEncoder
from dohyo.evaluation.agent import Mission, Observation

SPEEDS = np.array([[0.0, 0.0], [6.0, 0.0], [9.0, 0.0]])
"""Target speed, m/s, and lane of each choice."""


class SmallView(SensorEncoder):
    """The view from above, a third as large, and the speed."""

    track = "privileged"
    sensors = ("speedometer", "birdseye_rgb")
    space = Dict(view=Box(0, 255, (3, 64, 64), np.uint8), speed=Box(0.0, 100.0, (1,)))

    def __init__(self) -> None:
        self.episodes = 0

    def reset(self, mission: Mission, seed: int) -> None:
        self.episodes += 1

    def encode(self, observation: Observation) -> dict[str, np.ndarray]:
        view = np.ascontiguousarray(observation["birdseye_rgb"][:, ::3, ::3])
        return {"view": view, "speed": observation["speedometer"][:1]}


class Pilot(nn.Module):
    """About 6 m/s in the route's lane, a little more or less by what is seen."""

    def __init__(self, frames: int) -> None:
        super().__init__()
        self.camera = nn.Sequential(nn.Conv2d(3 * frames, 4, 8, 8), nn.ReLU(), nn.Flatten(), nn.Linear(256, 1))

    def forward(self, observation: Mapping[str, Tensor]) -> Tensor:
        speed = 6.0 + torch.tanh(self.camera(observation["view"].float() / 255.0)) - 0.01 * observation["speed"]
        return torch.cat([speed, torch.zeros_like(speed)], dim=-1)

    def facts(self) -> Mapping[str, str]:
        return {}


class Chooser(nn.Module):
    """The second of three speeds while slow, the first one otherwise."""

    def forward(self, observation: Mapping[str, Tensor]) -> Tensor:
        return (observation["speed"][:, 0] < 6.0).long()

    def facts(self) -> Mapping[str, str]:
        return {}


class Seeing(PolicyAgent):
    def __init__(self, policy: str) -> None:
        super().__init__("seeing", Path(policy), SmallView(), AsControl("lane_command"), frames=2, action_repeat=2)


class Choosing(PolicyAgent):
    def __init__(self, policy: str, decoder: ActionDecoder | None = None) -> None:
        super().__init__("choosing", Path(policy), SmallView(), decoder or Choices("lane_command", SPEEDS))
