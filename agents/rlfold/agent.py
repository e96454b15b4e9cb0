"""RLfOLD as an agent: target speed and steering from a camera's picture and the route's next points."""

from __future__ import annotations

from dohyo.agents.endless_driving.agent import EndlessDriver


class Rlfold(EndlessDriver):
    """A policy of RLfOLD."""

    trainer = "rlfold"
