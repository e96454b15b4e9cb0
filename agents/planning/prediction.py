"""Predictor: forecast of all actors for the next eight seconds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dohyo.agents.planning.scene import Scene
from dohyo.sumo_networks.arrays import FloatArray

HORIZON_S = 8.0
STEP_S = 0.1
STEPS = 81
NEAREST = 30
"""Number of nearest actors to predict; those beyond may be extrapolated."""


@dataclass(frozen=True, slots=True)
class Forecast:
    """Poses at 0, 0.1, ..., 8 s in the ego's frame of the scene.

    Attributes:
        actors: (N, 81, 3) x, y [m], heading [rad] of every actor of the scene, in its order; row 0 is the present.
        ego: (81, 3) predicted motion of the ego; None without a prediction.
    """

    actors: FloatArray
    ego: FloatArray | None


class Predictor(Protocol):
    """Predicts all actors. The same scene gives the same forecast, independent of earlier calls."""

    def predict(self, scene: Scene) -> Forecast:
        """Forecast of one scene."""
        ...


def constant_velocity(scene: Scene) -> FloatArray:
    """(N, 81, 3) poses of actors at constant velocity."""
    actors, ahead = scene.actors, np.arange(STEPS) * STEP_S
    out = np.empty((len(actors), STEPS, 3))
    travelled = actors.speed[:, None] * ahead
    out[:, :, 0] = actors.position[:, :1] + travelled * np.cos(actors.heading)[:, None]
    out[:, :, 1] = actors.position[:, 1:] + travelled * np.sin(actors.heading)[:, None]
    out[:, :, 2] = actors.heading[:, None]
    return out
