"""Crossing: bicycles that cross the ego's path outside lanes, which the sensor `conflicts` does not predict."""

from __future__ import annotations

import numpy as np

from dohyo.agents.planning.surroundings import Surroundings
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.world import ActorKind

ACROSS = 0.7
SIGHT_M = 25.0
MARGIN_M = 0.5


def crossers(around: Surroundings, half_length: float, half_width: float) -> Float32Array:
    """(N, 8) rows as of `sensors.conflicts`, for bicycles at constant velocity, with the kind of pedestrians."""
    rows = []
    reach = half_width + MARGIN_M
    for one in around.driving():
        if one.kind != ActorKind.BICYCLE or abs(one.across) < ACROSS or one.s_high < -half_length:
            continue
        # Lateral distances until it enters, and has left, the strip that the ego needs.
        if one.across > 0.0:
            first, last = -reach - one.d_high, reach - one.d_low
        else:
            first, last = one.d_low - reach, one.d_high + reach
        if last < 0.0 or first > SIGHT_M:
            continue
        share = abs(one.across)
        ahead = one.s_low - half_length, one.s_high + half_length
        rows.append((*ahead, first / share, last / share, one.speed, 1.0, float(ActorKind.PEDESTRIAN), one.key))
    return np.array(rows, dtype=np.float32).reshape(-1, 8)
