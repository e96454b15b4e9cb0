"""RLAD as an agent: target speed and steering from a camera's picture and the route's next points."""

from __future__ import annotations

from dohyo.agents.endless_driving.agent import EndlessDriver
from dohyo.agents.endless_driving.observation import View
from dohyo.agents.endless_driving.task import TownConfig


class Rlad(EndlessDriver):
    """A policy of RLAD or of a rival."""

    def __init__(self, policy: str, view: View = "picture") -> None:
        """Reads the policy.

        Args:
            policy: ONNX file of a training.
            view: "state" for the twin without pixels.

        Raises:
            InvalidInputError: The file is missing, or needs other observations.
        """
        super().__init__("rlad", policy, TownConfig(), view)
