"""Predictor: a forecaster, for the worker loop, which hands every agent a mission and observations by sensor."""

from __future__ import annotations

import numpy as np

from dohyo.agents.forecasting.agent import ForecastAgent
from dohyo.evaluation.agent import Agent, Mission, Observation


class Predictor(Agent):
    """Forecasts the days of a service.

    Attributes:
        inner: The forecaster.
    """

    def __init__(self, inner: ForecastAgent) -> None:
        self.inner = inner
        self.spec = inner.spec  # type: ignore[assignment]  # it has the same properties

    def reset(self, mission: Mission, seed: int) -> None:
        """See `Agent`; a day has no mission."""
        self.inner.reset(seed)

    def act(self, observation: Observation) -> np.ndarray:
        """See `Agent`."""
        return np.asarray(self.inner.act(observation))

    def close(self) -> None:
        """See `Agent`."""
        self.inner.close()
