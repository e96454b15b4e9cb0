"""Predictor: where everybody will be in the next eight seconds."""

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
"""How many actors a predictor has to look at; those beyond may be extrapolated."""


@dataclass(frozen=True, slots=True)
class Forecast:
    """Poses at 0, 0.1, ..., 8 s in the ego's frame of the scene.

    Attributes:
        actors: (N, 81, 3) x, y [m], heading [rad] of every actor of the scene, in its order; at 0 where it is.
        ego: (81, 3) what the predictor takes the ego to do; None where it has no opinion.
    """

    actors: FloatArray
    ego: FloatArray | None


class Predictor(Protocol):
    """Says where everybody goes. The same scene gives the same forecast, whatever came before."""

    def predict(self, scene: Scene) -> Forecast:
        """The next eight seconds of one scene."""
        ...


def constant_velocity(scene: Scene) -> FloatArray:
    """(N, 81, 3) every actor straight on at its speed."""
    actors, ahead = scene.actors, np.arange(STEPS) * STEP_S
    out = np.empty((len(actors), STEPS, 3))
    travelled = actors.speed[:, None] * ahead
    out[:, :, 0] = actors.position[:, :1] + travelled * np.cos(actors.heading)[:, None]
    out[:, :, 1] = actors.position[:, 1:] + travelled * np.sin(actors.heading)[:, None]
    out[:, :, 2] = actors.heading[:, None]
    return out
