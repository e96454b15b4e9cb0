"""What the driver sees through a frozen encoder: features of its last four pictures, its speed, and the command.

A picture is encoded once, in the process that drives; replay and learner hold its features alone. The encoder is that
of semantic pictures, which GHRL ships; `affordances` has another one.

Source: Chekroun 2024, section 4.3; speed and command are those of Toromanoff et al. 2020, since the thesis lists none.
"""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from typing import Final

import numpy as np
from gymnasium.spaces import Box, Dict

from dohyo.agents.gri.driving.state import SPEED_M_S
from dohyo.agents.hierarchical.vision.latents import SHIPPED, Encoder
from dohyo.agents.learning.policies.policy_agent import SensorEncoder
from dohyo.agents.learning.tasks.task import Array
from dohyo.evaluation.agent import Mission, Observation
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.routes.command import Command

CAMERA: Final = "camera_semantic"
PICTURES: Final = 4
"""Of the last 0.3 s."""
LATENTS: Final = 400


def features_space(name: str, length: int) -> Dict:
    """Space of four encodings under a name, and of (7,) speed and command, "itself".

    Args:
        name: Differs for each encoder, so that a policy tells which one it needs.
        length: Of one encoding.
    """
    boxes = {name: PICTURES * length, "itself": 1 + len(Command)}
    return Dict({key: Box(-np.inf, np.inf, (size,), np.float32) for key, size in boxes.items()})


class LastFeatures(SensorEncoder):
    """Features of the last four ticks, the oldest first, and speed and command. A subclass encodes one tick.

    Attributes:
        name: Of the features in the space.
    """

    track = "sensors"
    name: str

    def __init__(self) -> None:
        """Remembers nothing."""
        self._last: deque[Array] = deque(maxlen=PICTURES)

    def reset(self, mission: Mission, seed: int) -> None:
        """See `SensorEncoder`."""
        self._last.clear()

    @abstractmethod
    def features_of(self, observation: Observation) -> Float32Array:
        """(F,) features of one tick."""

    def encode(self, observation: Observation) -> dict[str, Array]:
        """See `SensorEncoder`; the features of an episode's first tick are repeated."""
        features = self.features_of(observation)
        self._last.extend([features] * (1 if self._last else PICTURES))
        command = np.eye(len(Command), dtype=np.float32)[int(observation["navigation"][0])]
        speed = np.float32(observation["speedometer"][0] / SPEED_M_S)
        return {self.name: np.concatenate(self._last), "itself": np.array([speed, *command], np.float32)}


class Pictures(LastFeatures):
    """(1600,) latents of semantic pictures, speed and command; see the module.

    Attributes:
        files: The encoder's weights.
    """

    name = "features"
    sensors = (CAMERA, "speedometer", "navigation")
    files = (SHIPPED,)
    space = features_space(name, LATENTS)

    def __init__(self) -> None:
        """Reads the encoder's weights."""
        super().__init__()
        self._encoder = Encoder()

    def features_of(self, observation: Observation) -> Float32Array:
        """See `LastFeatures`."""
        return self._encoder.latent(observation[CAMERA])
