"""Learned prior: the actions that follow the predictor's ego trajectory."""

from __future__ import annotations

import math

import numpy as np

from dohyo.agents.mcts.config import ACTIONS, DT, MIDDLE, Rules
from dohyo.agents.planning.motion import Body, project
from dohyo.agents.planning.situation import Situation
from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.portable_math import exp


def kernel(variance: float) -> FloatArray:
    """(13,) Gaussian of the priors by index distance."""
    return np.asarray(exp(-(np.arange(ACTIONS) ** 2) / (2.0 * variance)))


def learned_actions(
    trajectory: FloatArray | None, road: Situation, car: Body, rules: Rules, seconds: float
) -> IntArray:
    """Nearest action to each stretch of a trajectory.

    Args:
        trajectory: (81, 3) the predictor's ego poses; None without one.
        road: The situation.
        car: The vehicle.
        rules: The numbers.
        seconds: Duration of the prior.

    Returns:
        (D, 2) indices of acceleration and steering; -1 where the prior does not hold.
    """
    out = np.full((rules.depth, 2), -1, dtype=np.int64)
    if trajectory is None:
        return out
    hold = rules.hold_steps
    speed = np.hypot(*np.diff(trajectory[:, :2], axis=0).T) / DT
    for k in range(min(rules.depth, math.ceil(seconds / (hold * DT) - 1e-9))):
        first, last = k * hold, (k + 1) * hold
        before, after = speed[min(first, len(speed) - 1)], speed[min(last, len(speed) - 1)]
        out[k, 0] = _index((after - before) / (hold * DT) / rules.acceleration_step)
        if rules.lane_steering:
            x, y = trajectory[min(last, len(speed)), :2]
            _, side, _ = project(road.path, road.first_s, road.spacing, float(x), float(y), 0.0, 1e6)
            out[k, 1] = _index(side / rules.steering_step)
        else:
            end = min(last, len(speed))  # the last action of a plan may last beyond the trajectory
            turn = (trajectory[end, 2] - trajectory[first, 2] + math.pi) % (2 * math.pi) - math.pi
            moved = max(float(speed[first:last].sum()) * DT, 0.5)
            out[k, 1] = _index(math.atan(car.wheelbase * turn / moved) / rules.steering_step)
    return out


def _index(steps: float) -> int:
    return min(max(MIDDLE + math.floor(float(steps) + 0.5), 0), ACTIONS - 1)
