"""Predictor: forecast of all actors for the next eight seconds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dohyo.agents.planning.scene import HISTORY_STEP_S, Scene
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.geometry import wrap_angle
from dohyo.sumo_networks.portable_math import exp
from dohyo.sumo_networks.world import ActorKind

STEP_S = 0.1
STEPS = 81
NEAREST = 30
"""Number of nearest actors to predict; those beyond may be extrapolated."""
TURNS_ON_S, TURNING_M_S = 1.5, 1.0
"""Time in which the rate of a turn falls to a third, s; speed from which a turn is seen, m/s."""


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


def constant_speed(scene: Scene) -> FloatArray:
    """(N, 81, 3) poses of actors at constant speed that go on turning as in the last 0.5 s, ever less.

    People, who turn on the spot, and actors seen for less than that go straight on.
    """
    actors = scene.actors
    steady = actors.history_valid[:, -2] & (actors.speed > TURNING_M_S) & (actors.kind != ActorKind.PEDESTRIAN)
    rate = np.where(steady, wrap_angle(actors.heading - actors.history[:, -2, 2]) / HISTORY_STEP_S, 0.0)
    out = np.empty((len(actors), STEPS, 3))
    places, between = np.linspace(0.0, STEPS - 1.0, STEPS), np.linspace(0.5, STEPS - 1.5, STEPS - 1)
    out[:, :, 2] = actors.heading[:, None] + rate[:, None] * _turned(places)
    middle = actors.heading[:, None] + rate[:, None] * _turned(between)
    step = actors.speed[:, None] * STEP_S
    out[:, 0, :2] = actors.position
    out[:, 1:, 0] = actors.position[:, :1] + np.add.accumulate(step * np.cos(middle), axis=1)
    out[:, 1:, 1] = actors.position[:, 1:] + np.add.accumulate(step * np.sin(middle), axis=1)
    return out


def _turned(steps: FloatArray) -> FloatArray:
    """What a turn of 1 rad/s now adds up to after some steps, rad."""
    return np.asarray(TURNS_ON_S * (1.0 - exp(-steps * STEP_S / TURNS_ON_S)))


def constant_velocity(scene: Scene) -> FloatArray:
    """(N, 81, 3) poses of actors at constant velocity."""
    actors, ahead = scene.actors, np.arange(STEPS) * STEP_S
    out = np.empty((len(actors), STEPS, 3))
    travelled = actors.speed[:, None] * ahead
    out[:, :, 0] = actors.position[:, :1] + travelled * np.cos(actors.heading)[:, None]
    out[:, :, 1] = actors.position[:, 1:] + travelled * np.sin(actors.heading)[:, None]
    out[:, :, 2] = actors.heading[:, None]
    return out
