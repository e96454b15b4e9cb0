"""Parker: an agent that parks, for the worker loop, which hands every agent a mission and observations by sensor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dohyo.evaluation.agent import Agent, Mission, Observation
from dohyo.evaluation.parking.agent import make_parking_agent


class Parker(Agent):
    """Parks one kart of an episode at a service.

    Attributes:
        inner: The agent.
    """

    def __init__(self, entry: str, settings: Mapping[str, Any]) -> None:
        """Makes the agent.

        Raises:
            InvalidInputError: It cannot be made.
        """
        self.inner = make_parking_agent(entry, settings)
        self.spec = self.inner.spec  # type: ignore[assignment]  # it has the same properties

    def reset(self, mission: Mission, seed: int) -> None:
        """See `Agent`; a kart has no mission."""
        self.inner.reset(seed)

    def act(self, observation: Observation) -> np.ndarray:
        """See `Agent`; there is one sensor."""
        (seen,) = observation.values()
        return self.inner.act(np.asarray(seen, np.float32))

    def close(self) -> None:
        """See `Agent`."""
        if hasattr(self.inner, "close"):
            self.inner.close()
