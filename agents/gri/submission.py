"""Submission: a policy of GRIAD that sees pictures as one ONNX model of the sensors, as a service takes it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnx
import torch
from torch import Tensor, nn

from dohyo.agents.gri.driving.choices import TABLE
from dohyo.agents.gri.driving.pictures import CAMERA, PICTURES, LastFeatures, Pictures
from dohyo.agents.gri.driving.state import SPEED_M_S
from dohyo.agents.gri.driving.task import ENCODERS, REPEAT
from dohyo.agents.gri.griad import sight_of
from dohyo.agents.gri.vision.cameras import CAMERAS
from dohyo.agents.gri.vision.frozen import weights_of
from dohyo.agents.hierarchical.vision.classes import CLASSES, OF_LABEL
from dohyo.agents.hierarchical.vision.latents import SHIPPED, load_weights
from dohyo.agents.hierarchical.vision.network import Encoder
from dohyo.agents.learning.policies.export import ACTION
from dohyo.agents.learning.policies.joining import CHOSEN, NEXT, TICKS, chained, decides, exported, joined, pushed
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.routes.command import Command
from dohyo.sumo_networks.sensors import make_sensors

LAST_LATENTS, LAST = "state_latents", "state_action"
DECIDES = "decides"


def submission_of(policy: Path) -> bytes:
    """The ONNX model, with the encoder of pictures in it.

    Raises:
        InvalidInputError: There is no such policy, or it sees the exact state.
    """
    sight = sight_of(policy)
    if not issubclass(sight, LastFeatures):
        seen = next(name for name, kind in ENCODERS.items() if kind is sight)
        raise InvalidInputError(f"'{policy}': expected a policy of pictures, this one is of 'driving-{seen}'")
    sensors = make_sensors(sight.sensors)
    inputs = {one.name: torch.from_numpy(np.zeros(one.space.shape, one.space.dtype)) for one in sensors}
    encoder = _semantic(inputs) if issubclass(sight, Pictures) else _affordances(inputs, sight)
    (told,) = encoder.graph.output
    features = told.type.tensor_type.shape.dim[-1].dim_value
    states = {TICKS: torch.zeros(1), LAST_LATENTS: torch.zeros(PICTURES, features)}
    measured = {name: inputs[name] for name in ("speedometer", "navigation")}
    names = [sight.name, "itself", DECIDES, NEXT + TICKS, NEXT + LAST_LATENTS]
    observing = exported(_Observing(), {told.name: torch.zeros(1, features), **measured, **states}, names)
    behind = {CHOSEN: torch.zeros(1, dtype=torch.int64), DECIDES: torch.ones(1, dtype=torch.bool), LAST: torch.zeros(2)}
    before = chained({"encoder": encoder, "observing": observing})
    return joined(before, policy, exported(_Acting(), behind, [ACTION, NEXT + LAST]))


def _semantic(inputs: Mapping[str, Tensor]) -> onnx.ModelProto:
    """The semantic camera to the latents."""
    return exported(_Semantic(), {CAMERA: inputs[CAMERA]}, ["latents"])


def _affordances(inputs: Mapping[str, Tensor], sight: type[LastFeatures]) -> onnx.ModelProto:
    """Three cameras to both encodings, by the shipped model."""
    frozen = onnx.load(weights_of(sight.name))
    (read,) = frozen.graph.input
    stacked = exported(_Stacking(), {name: inputs[name] for name in CAMERAS}, [read.name])
    return chained({"stacked": stacked, "frozen": frozen})


class _Semantic(nn.Module):
    """What `Pictures.features_of` does."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = Encoder()
        weights = {name: torch.from_numpy(array) for name, array in load_weights(SHIPPED).items()}
        self.encoder.load_state_dict(weights)
        self.register_buffer("classes", torch.from_numpy(OF_LABEL).long())

    def forward(self, camera: Tensor) -> Tensor:
        """(1, 80, 160) picture to (1, 400) latents."""
        seen = self.get_buffer("classes")[camera.long()] == torch.arange(CLASSES)[:, None, None]
        latents: Tensor = self.encoder.encode(seen.float()[None])
        return latents


class _Stacking(nn.Module):
    """What `cameras.pictures` does."""

    def forward(self, left: Tensor, centre: Tensor, right: Tensor) -> Tensor:
        """Three (3, 64, 64) pictures to (1, 3, 3, 64, 64)."""
        return torch.stack([left, centre, right])[None]


class _Observing(nn.Module):
    """What `LastFeatures` does with the features of a tick."""

    def forward(
        self, latest: Tensor, speedometer: Tensor, navigation: Tensor, ticks: Tensor, features: Tensor
    ) -> tuple[Tensor, ...]:
        """Features, sensors and states -> the policy's inputs, whether it decides, and the next states."""
        features = pushed(features, latest[0], ticks)
        command = (navigation[:1] == torch.arange(len(Command))).float()
        itself = torch.cat([speedometer[:1] / SPEED_M_S, command])
        return features.reshape(1, -1), itself[None], decides(ticks, REPEAT), ticks + 1.0, features


class _Acting(nn.Module):
    """What `Choices` and a repeated choice do."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("table", torch.from_numpy(TABLE))

    def forward(self, chosen: Tensor, now: Tensor, last: Tensor) -> tuple[Tensor, Tensor]:
        """The number of a choice (1,) -> its action (2,), and the action that is held."""
        action = torch.where(now, self.get_buffer("table")[chosen[0]], last)
        return action, action
