"""Submission: a policy of GRIAD that sees pictures as one ONNX model of the sensors, as a service takes it."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor, nn

from dohyo.agents.gri.driving.choices import TABLE
from dohyo.agents.gri.driving.pictures import LATENTS, PICTURES, Pictures
from dohyo.agents.gri.driving.state import SPEED_M_S
from dohyo.agents.gri.driving.task import ENCODERS, REPEAT
from dohyo.agents.gri.griad import sight_of
from dohyo.agents.hierarchical.vision.classes import CLASSES, OF_LABEL
from dohyo.agents.hierarchical.vision.latents import SHIPPED, load_weights
from dohyo.agents.hierarchical.vision.network import Encoder
from dohyo.agents.learning.policies.export import ACTION
from dohyo.agents.learning.policies.joining import CHOSEN, NEXT, TICKS, decides, exported, joined, pushed
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.routes.command import Command
from dohyo.sumo_networks.sensors import make_sensors

LAST_LATENTS, LAST = "state_latents", "state_action"
DECIDES = "decides"


def submission_of(policy: Path) -> bytes:
    """The ONNX model, with the encoder of pictures in it.

    Raises:
        InvalidInputError: There is no such policy, or it sees something else, such as the exact state.
    """
    if (sight := sight_of(policy)) is not Pictures:
        seen = next(name for name, kind in ENCODERS.items() if kind is sight)
        raise InvalidInputError(f"'{policy}': expected a policy of pictures, this one is of 'driving-{seen}'")
    camera, speedometer, navigation = make_sensors(Pictures.sensors)
    sensors = {
        camera.name: torch.zeros(camera.space.shape, dtype=torch.uint8),
        speedometer.name: torch.zeros(speedometer.space.shape),
        navigation.name: torch.zeros(navigation.space.shape),
    }
    states = {TICKS: torch.zeros(1), LAST_LATENTS: torch.zeros(PICTURES, LATENTS)}
    names = ["features", "itself", DECIDES, NEXT + TICKS, NEXT + LAST_LATENTS]
    before = exported(_Observing(), {**sensors, **states}, names)
    behind = {CHOSEN: torch.zeros(1, dtype=torch.int64), DECIDES: torch.ones(1, dtype=torch.bool), LAST: torch.zeros(2)}
    return joined(before, policy, exported(_Acting(), behind, [ACTION, NEXT + LAST]))


class _Observing(nn.Module):
    """What `Pictures` does."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = Encoder()
        weights = {name: torch.from_numpy(array) for name, array in load_weights(SHIPPED).items()}
        self.encoder.load_state_dict(weights)
        self.register_buffer("classes", torch.from_numpy(OF_LABEL).long())

    def forward(
        self, camera: Tensor, speedometer: Tensor, navigation: Tensor, ticks: Tensor, latents: Tensor
    ) -> tuple[Tensor, ...]:
        """Sensors and states -> the policy's inputs, whether it decides, and the next states."""
        seen = self.get_buffer("classes")[camera.long()] == torch.arange(CLASSES)[:, None, None]
        latents = pushed(latents, self.encoder.encode(seen.float()[None])[0], ticks)
        command = (navigation[:1] == torch.arange(len(Command))).float()
        itself = torch.cat([speedometer[:1] / SPEED_M_S, command])
        return latents.reshape(1, -1), itself[None], decides(ticks, REPEAT), ticks + 1.0, latents


class _Acting(nn.Module):
    """What `Choices` and a repeated choice do."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("table", torch.from_numpy(TABLE))

    def forward(self, chosen: Tensor, now: Tensor, last: Tensor) -> tuple[Tensor, Tensor]:
        """The number of a choice (1,) -> its action (2,), and the action that is held."""
        action = torch.where(now, self.get_buffer("table")[chosen[0]], last)
        return action, action
