"""Submission: a policy of RLAD or RLfOLD as one ONNX model of the sensors, as a service takes it."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor, nn

from dohyo.agents.endless_driving.agent import town_of
from dohyo.agents.endless_driving.config import TownConfig
from dohyo.agents.endless_driving.observation import (
    ACTION_REPEAT,
    FAR_M,
    MAX_STEERING,
    MEASUREMENTS,
    PICTURE,
    POINTS,
    SPACING_M,
    WAYPOINTS,
    make_view,
)
from dohyo.agents.learning.policies.export import ACTION
from dohyo.agents.learning.policies.joining import CHOSEN, NEXT, TICKS, decides, exported, joined, pushed
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.sensors import make_sensors

PICTURES, MEASURED, LAST = "state_pictures", "state_measured", "state_action"
DECIDES = "decides"


def submission_of(policy: Path, trainer: str) -> bytes:
    """The ONNX model.

    Args:
        policy: Of a training, with its card beside it.
        trainer: "rlad" or "rlfold".

    Raises:
        InvalidInputError: There is no such policy, or it is one of the twin, whose state is no sensor.
    """
    town = town_of(policy, trainer)
    if town.view != "picture":
        raise InvalidInputError(f"'{policy}': expected a policy of pictures, this one sees the exact state")
    speed, route, camera = make_sensors(make_view(town.view, town.max_speed, town.history, town.side).sensors)
    seen = {one.name: torch.zeros(one.space.shape, dtype=torch.float32) for one in (speed, route)}
    seen |= {camera.name: torch.zeros(camera.space.shape, dtype=torch.uint8)}
    states = {
        TICKS: torch.zeros(1),
        PICTURES: torch.zeros(town.frames - 1, *camera.space.shape),
        MEASURED: torch.zeros(ACTION_REPEAT * (town.history - 1) + 1, 2),
    }
    if town.frames == 1:
        del states[PICTURES]
    names = [PICTURE, WAYPOINTS, MEASUREMENTS, DECIDES, *(NEXT + one for one in states)]
    before = exported(_Observing(town), {**seen, **states}, names)
    behind = {CHOSEN: torch.zeros(1, 2), DECIDES: torch.ones(1, dtype=torch.bool), LAST: torch.zeros(2)}
    return joined(before, policy, exported(_Acting(town), behind, [ACTION, NEXT + LAST]))


class _Observing(nn.Module):
    """What `PictureView` and a stack of frames do."""

    def __init__(self, town: TownConfig) -> None:
        super().__init__()
        self._town = town

    def forward(
        self, speedometer: Tensor, route: Tensor, camera: Tensor, ticks: Tensor, *memories: Tensor
    ) -> tuple[Tensor, ...]:
        """Sensors and states -> the policy's inputs, whether it decides, and the next states."""
        *pictures, measured = memories
        now, picture = decides(ticks, ACTION_REPEAT), camera.float()
        measured = pushed(measured, speedometer / torch.tensor([self._town.max_speed, MAX_STEERING]), ticks)
        points = route[SPACING_M : SPACING_M * (POINTS + 1) : SPACING_M, :2] / FAR_M
        stack, kept = picture[None], []
        if pictures:
            first = picture[None].expand(pictures[0].shape)
            earlier = torch.where(ticks.reshape(1, 1, 1, 1) < 0.5, first, pictures[0])
            stack = torch.cat([earlier, stack])
            kept = [torch.where(now.reshape(1, 1, 1, 1), stack[1:], earlier)]
        seen = stack.reshape(1, -1, *camera.shape[1:]).to(torch.uint8)
        return seen, points.reshape(1, -1), measured[::ACTION_REPEAT].reshape(1, -1), now, ticks + 1.0, *kept, measured


class _Acting(nn.Module):
    """What `TargetSpeed` and a repeated action do."""

    def __init__(self, town: TownConfig) -> None:
        super().__init__()
        self._max_speed, self._stand_below = town.max_speed, town.stand_below

    def forward(self, chosen: Tensor, now: Tensor, last: Tensor) -> tuple[Tensor, Tensor]:
        """The policy's action (1, 2) -> action of `target_speed_steering` (2,), and the action that is held."""
        action = torch.where(now, chosen[0], last)
        speed = (action[0] + 1.0) / 2.0 * self._max_speed
        stands = speed < self._stand_below
        return torch.stack([torch.where(stands, torch.zeros_like(speed), speed), action[1]]), action
