"""Braking: vehicles that brake are forecast to go on braking for a second."""

from __future__ import annotations

import numpy as np

from dohyo.agents.planning.prediction import STEP_S
from dohyo.agents.planning.scene import HISTORY_STEP_S, Scene, TrackedActors
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.world import ActorKind

GOES_ON_S, LEAST, HARDEST = 1.0, 1.0, 8.0
"""Time for which braking goes on, s; what counts as braking, and the hardest that is believed, m/s^2."""
MOVING_M_S = 0.1


def braking_on(scene: Scene, forecast: FloatArray) -> FloatArray:
    """Forecast in which vehicles that brake go on braking for a second, and then keep the speed that is left.

    Args:
        scene: Of the forecast.
        forecast: (N, 81, 3) x, y [m], heading [rad] of its actors at constant speed.

    Returns:
        The same way, driven more slowly: a copy if anybody brakes, else the same array.
    """
    actors, braking = scene.actors, decelerations(scene.actors)
    vehicles = (actors.kind != ActorKind.PEDESTRIAN) & (actors.speed > MOVING_M_S)
    brake = np.flatnonzero(vehicles & (braking > LEAST))
    if not len(brake):
        return forecast
    speed, braking = actors.speed[brake, None], braking[brake, None]
    lasts = np.minimum(GOES_ON_S, speed / braking)
    times = np.arange(forecast.shape[1]) * STEP_S
    within = np.minimum(times, lasts)
    travelled = speed * within - 0.5 * braking * within**2 + (speed - braking * lasts) * (times - within)
    steps = travelled / (speed * STEP_S)
    before = np.minimum(steps.astype(np.int64), forecast.shape[1] - 2)
    share, row = (steps - before)[:, :, None], brake[:, None]
    out = forecast.copy()
    out[brake] = forecast[row, before] * (1.0 - share) + forecast[row, before + 1] * share
    return out


def decelerations(actors: TrackedActors) -> FloatArray:
    """(N,) present deceleration, from 0 to 8 m/s^2: the loss of speed since the middle of the last half second.

    It is 0 for who was not seen for half a second.
    """
    moved = actors.history[:, -1, :2] - actors.history[:, -2, :2]
    earlier = np.hypot(moved[:, 0], moved[:, 1]) / HISTORY_STEP_S
    braking = np.clip((earlier - actors.speed) / (0.5 * HISTORY_STEP_S), 0.0, HARDEST)
    return np.where(actors.history_valid[:, -2], braking, 0.0)
