"""Constant velocity; or CTRA: constant turn rate and acceleration."""

from __future__ import annotations

from typing import Literal

import numpy as np

from dohyo.agents.planning.prediction import STEP_S, STEPS, Forecast
from dohyo.agents.planning.scene import HISTORY_STEP_S, Scene
from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.geometry import wrap_angle

Model = Literal["velocity", "ctra"]
MOST_ACCELERATION, MOST_TURN_RATE = 3.0, 0.8


class ConstantVelocity:
    """Constant velocity or CTRA: the simplest predictor.

    Attributes:
        model: "velocity": heading and speed stay. "ctra": turn rate and acceleration of the last second stay, down to a
            standstill.

    Source: CTRA after Schubert, Richter, Wanielik 2008.
    """

    def __init__(self, model: Model = "velocity") -> None:
        if model not in ("velocity", "ctra"):
            raise InvalidInputError(f"expected the model 'velocity' or 'ctra', got {model!r}")
        self.model = model

    def predict(self, scene: Scene) -> Forecast:
        """See the class; the ego is predicted like any other."""
        ego, actors = scene.ego, scene.actors
        history = np.concatenate([ego.history[None], actors.history])
        speed = np.concatenate([[ego.speed], actors.speed])
        if self.model == "velocity":
            rate, acceleration = np.zeros(len(speed)), np.zeros(len(speed))
        else:
            valid = np.concatenate([ego.history_valid[None], actors.history_valid])
            rate, acceleration = _motion(history, valid, speed)
        poses = roll(history[:, -1], speed, acceleration, rate)
        poses[1:, 0] = np.column_stack([actors.position, actors.heading])
        return Forecast(actors=poses[1:], ego=poses[0])


def roll(pose: FloatArray, speed: FloatArray, acceleration: FloatArray, rate: FloatArray) -> FloatArray:
    """Poses under constant acceleration and turn rate, until standstill.

    Args:
        pose: (N, 3) x, y [m], heading [rad].
        speed: (N,), m/s.
        acceleration: (N,), m/s^2.
        rate: (N,), rad/s.

    Returns:
        (N, 81, 3) every 0.1 s; steps are integrated by the midpoint rule.
    """
    ahead = np.arange(STEPS) * STEP_S
    fast = np.maximum(speed[:, None] + acceleration[:, None] * ahead, 0.0)
    moved = 0.5 * (fast[:, 1:] + fast[:, :-1]) * STEP_S
    # Actors that stand do not turn on the spot.
    turned = rate[:, None] * STEP_S * (moved > 0.0)
    heading = pose[:, 2:] + np.concatenate([np.zeros((len(pose), 1)), np.cumsum(turned, axis=1)], axis=1)
    middle = 0.5 * (heading[:, 1:] + heading[:, :-1])
    out = np.empty((len(pose), STEPS, 3))
    out[:, 0, :2] = pose[:, :2]
    out[:, 1:, 0] = pose[:, :1] + np.cumsum(moved * np.cos(middle), axis=1)
    out[:, 1:, 1] = pose[:, 1:2] + np.cumsum(moved * np.sin(middle), axis=1)
    out[:, :, 2] = heading
    return out


def _motion(history: FloatArray, valid: BoolArray, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turn rate [rad/s] and acceleration [m/s^2] over the last second; 0 without so long a history."""
    whole = valid[:, 1:].all(axis=1)
    rate = wrap_angle(history[:, -1, 2] - history[:, -3, 2]) / (2 * HISTORY_STEP_S)
    mean = np.hypot(*(history[:, -1, :2] - history[:, -3, :2]).T) / (2 * HISTORY_STEP_S)
    acceleration = (speed - mean) / HISTORY_STEP_S  # the mean speed was its speed half a second ago
    return (
        np.where(whole, np.clip(rate, -MOST_TURN_RATE, MOST_TURN_RATE), 0.0),
        np.where(whole, np.clip(acceleration, -MOST_ACCELERATION, MOST_ACCELERATION), 0.0),
    )
