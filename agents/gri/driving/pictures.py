"""What the driver sees through a frozen encoder: features of its last four pictures, its speed, and the command.

A picture is encoded once, in the process that drives; replay and learner hold its features alone. The encoder is that
of semantic pictures, which GHRL ships.

Source: Chekroun 2024, section 4.3; speed and command are those of Toromanoff et al. 2020, since the thesis lists none.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np
from gymnasium.spaces import Box, Dict

from dohyo.agents.gri.driving.state import SPEED_M_S
from dohyo.agents.hierarchical.vision.latents import SHIPPED, Encoder
from dohyo.agents.learning.policies.policy_agent import SensorEncoder
from dohyo.agents.learning.tasks.task import Array
from dohyo.evaluation.agent import Mission, Observation
from dohyo.sumo_networks.routes.command import Command

CAMERA: Final = "camera_semantic"
PICTURES: Final = 4
"""Of the last 0.3 s."""
LATENTS: Final = 400


class Pictures(SensorEncoder):
    """(1600,) features, the oldest picture's first, and (7,) speed and command; see the module.

    Attributes:
        files: The encoder's weights.
    """

    track = "sensors"
    sensors = (CAMERA, "speedometer", "navigation")
    files = (SHIPPED,)
    space = Dict(
        {
            "features": Box(-np.inf, np.inf, (PICTURES * LATENTS,), np.float32),
            "itself": Box(-np.inf, np.inf, (1 + len(Command),), np.float32),
        }
    )

    def __init__(self) -> None:
        """Reads the encoder's weights."""
        self._encoder = Encoder()
        self._last: deque[Array] = deque(maxlen=PICTURES)

    def reset(self, mission: Mission, seed: int) -> None:
        """See `SensorEncoder`."""
        self._last.clear()

    def encode(self, observation: Observation) -> dict[str, Array]:
        """See `SensorEncoder`; an episode's first picture is repeated."""
        features = self._encoder.latent(observation[CAMERA])
        self._last.extend([features] * (1 if self._last else PICTURES))
        command = np.eye(len(Command), dtype=np.float32)[int(observation["navigation"][0])]
        speed = np.float32(observation["speedometer"][0] / SPEED_M_S)
        return {"features": np.concatenate(self._last), "itself": np.array([speed, *command], np.float32)}
